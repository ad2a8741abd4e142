"""From raw images and a reference to a campaign that can be calibrated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...imagery.chain import MeasuredImage
from ...imagery.own_scatter import seen_of_reference, unexplained_px
from ...imagery.scene import Scene
from ...imagery.targets.chain import TargetScene
from ...io.campaign.files import names_of
from ...io.campaign.read import LoadedImages
from ...io.campaign.write import landmarks_text
from ...io.imagery.kept import KeptImages
from ...io.imagery.tables import Marks, campaign_text
from ...io.text.files import read_text
from ...physics.earth import C_JT, itrf_to_geodetic
from ...physics.errors import InputError
from ...report.text import counted
from ...table.campaign import Landmarks
from ..arguments import Folder, checked
from ..show import Shown

if TYPE_CHECKING:
    from ...disk.publish import Content
    from ...report.page import Table

Array = NDArray[np.float64]

MEASURE = "measure.json"
FILES = ("campaign.toml", "landmarks.csv", "observations.csv", "detections.csv", "measure.html")
"""Files beside measure.json: those that a new measurement does not write are removed."""


@dataclass(frozen=True, repr=False, eq=False)
class Measurement(Shown):
    """What :func:`starplumb.measure` found: ``document`` is ``measure.json``; ``save`` writes it and the campaign."""

    made_by: ClassVar[str] = "measure"

    path: Path
    loaded: LoadedImages
    scene: Scene | TargetScene
    images: tuple[MeasuredImage, ...]
    kept: KeptImages | None = None

    @property
    def acquired(self) -> int:
        """How many images were measured."""
        return sum(not image.reason for image in self.images)

    @property
    def usable(self) -> bool:
        """Whether any image, and at least half of them, were measured."""
        return self.acquired > 0 and 2 * self.acquired >= len(self.images)

    @property
    def marks_name(self) -> str:
        """The section of the campaign written that names its marks."""
        return "observations"

    @property
    def message(self) -> str:
        """What should be known of the images that were left out."""
        if self.acquired == len(self.images):
            return ""
        of = f"{self.acquired} of {counted(len(self.images), 'image')} could be measured"
        first = next(image for image in self.images if image.reason)
        return f"{of}; {self._name(first)}: {first.reason}"

    @cached_property
    def floor_px(self) -> float:
        """What is added to the sigmas of matching: the scatter of chips beyond them and the reference's own error."""
        measured = [image for image in self.images if not image.reason]
        if not any(image.floor_px for image in measured):
            return 0.0
        return unexplained_px(self.scene, measured, self._sigma_m, self._length_m or 0.0)

    @cached_property
    def reference_px2(self) -> tuple[float, ...]:
        """Variance, mean of both axes, by which the reference's own errors scatter the chips of each image; 0 where it
        is not known which is which, and for an image that was left out."""
        sigma, length = self._sigma_m, self._length_m or 0.0
        return tuple(
            0.0
            if image.reason or any(chip.p_J is None for chip in image.used)
            else seen_of_reference(self.scene, image, sigma, length)
            for image in self.images
        )

    @cached_property
    def document(self) -> dict[str, Any]:
        """``measure.json``."""
        from ...documents.imagery.from_measurement import measure_document

        return measure_document(self)

    @property
    def tables(self) -> Sequence[Table]:
        """The images with their chips by verdict."""
        from ...report.page import Table

        rows = []
        for image in self.images:
            verdicts = [str(chip.candidate.verdict) for chip in image.chips]
            refused = sorted({v for v in verdicts if v != "used"})
            why = ", ".join(f"{verdicts.count(v)} {v}" for v in refused)
            used = f"{verdicts.count('used')} of {len(verdicts)}"
            rows.append((self._name(image), "left out" if image.reason else "measured", used, why))
        head = ("image", "", "chips used", "others")
        return [Table(f"Images of {self.loaded.campaign.name}", head, rows, text_columns=4)]

    @property
    def sentences(self) -> Sequence[str]:
        out = [f"{self._name(image)} left out: {image.reason}" for image in self.images if image.reason]
        used = sum(len(image.used) for image in self.images if not image.reason)
        what = f"{counted(used, 'chip')} of {self.acquired} of {counted(len(self.images), 'image')} measured"
        if self.floor_px > 0.0:
            what += f"; {self.floor_px:.3f} px added to their sigmas for what they scatter beyond them"
        return [*out, what]

    @property
    def marks(self) -> Marks:
        """The chips used, of the images that were measured."""
        used = [(image, c) for image in self.images if not image.reason for c in image.used]
        extra = self.floor_px**2 * np.eye(2)
        return Marks(
            [self._name(image) for image, _ in used],
            [c.landmark_id(self._name(image)) for image, c in used],
            np.array([np.full(3, np.nan) if c.p_J is None else c.p_J for _, c in used]).reshape(-1, 3),
            np.array([c.pixel for _, c in used]).reshape(-1, 2) + self.loaded.shift_px,
            np.array([c.covariance for _, c in used]).reshape(-1, 2, 2) + extra,
            np.array([c.check for _, c in used], dtype=np.bool_),
        )

    @checked
    def save(self, folder: Folder, report: bool = True) -> None:
        """Write ``measure.json``, the page ``measure.html`` and, where images were measured, ``landmarks.csv``,
        ``observations.csv`` and ``campaign.toml``, which names them.

        Raises InputError where the folder cannot be written to, or holds what is no earlier measurement.
        """
        from ...disk.publish import publish
        from ...io.text.write import marked

        out = Path(folder)
        files: dict[str, Content] = {}
        if self.acquired:
            names, length = names_of(self.loaded.config), self._length_m
            files = self._tables()
            files["campaign.toml"] = campaign_text(
                read_text(self.path), self.loaded.folder, out, names, length, self.marks_name
            )
        if report:
            files["measure.html"] = self.report()
        mark = marked(MEASURE, self.document)
        publish(out, files, instead_of=FILES, mark=mark, inputs=self.loaded.sources)
        if self.kept is not None:
            self.kept.remove()

    def _tables(self) -> dict[str, Content]:
        """The tables that ``campaign.toml`` names, by their files."""
        marks, surveyed = self.marks, self._surveyed
        if surveyed is None:
            landmarks = marks.landmarks(self._reference.sigma_m)
        else:
            landmarks = landmarks_text(seen_of(surveyed, marks.landmark_ids))
        return {"landmarks.csv": landmarks, "observations.csv": marks.observations()}

    def report(self) -> str:
        """The page ``measure.html``: every chip for the eye."""
        from ...report.imagery.measurement import measurement_page

        chips = [chip for image in self.images for chip in image.chips]
        return measurement_page(self.document, [chip.picture for chip in chips if chip.picture is not None])

    @checked
    def save_chips(self, folder: Folder) -> int:
        """Cut the chips that were used out of the orthoimage, with the heights around them, and write them as a library
        that [reference] with kind = "chips" reads, into a new folder; how many there are.

        Raises InputError where the reference is no orthoimage, nothing was measured, or something is in the folder.
        """
        from ...io.imagery.cutting import Cut, write_library
        from .library import to_cut

        place, reference = Path(folder), self._reference
        require_cut(place, reference.kind)
        assert isinstance(self.scene, Scene)
        assert self.loaded.config.measure is not None
        centres = to_cut(self.scene, self.images, self.loaded.config.measure.chip_px)
        return write_library(
            place, self.scene, Cut(*centres, reference.sigma_m, reference.correlation_length_m)
        )

    @property
    def _surveyed(self) -> Landmarks | None:
        """The landmarks of a reference that has some of its own: targets, or a library's chips."""
        landmarks = self.loaded.campaign.landmarks
        return landmarks if landmarks.ids else None

    @property
    def _length_m(self) -> float | None:
        """Over which distance the reference's error is alike."""
        surveyed = self._surveyed
        return self._reference.correlation_length_m if surveyed is None else surveyed.correlation_length

    @property
    def _sigma_m(self) -> Array:
        """The reference's sigma (3,) east, north, up, of a library the root mean square of its chips'."""
        surveyed = self._surveyed
        if surveyed is None:
            return np.array(self._reference.sigma_m, dtype=np.float64)
        C = C_JT(*itrf_to_geodetic(surveyed.r_J)[:2])
        along = np.diagonal(C.mT @ surveyed.covariance_J @ C, axis1=-2, axis2=-1)
        return np.asarray(np.sqrt(along.mean(axis=0)))

    def _name(self, image: MeasuredImage) -> str:
        return self.loaded.campaign.images.ids[image.image]

    @property
    def _reference(self) -> Any:
        return self.loaded.config.reference


def require_place(folder: Path, campaign: Path) -> None:
    """Raise InputError before the work where a measurement of a campaign could not be written into a folder."""
    from ...disk.owned import require_replaceable
    from ...documents.imagery.measure import MeasureDocument

    require_replaceable(folder, [*FILES, MEASURE], [campaign], (MEASURE, MeasureDocument.kind()))


def require_cut(folder: Path, kind: str) -> None:
    """Raise InputError before the work where no library could be cut from this kind of reference into a folder."""
    from ...io.imagery.cutting import require_new_folder

    if kind != "ortho":
        raise InputError(
            f'{folder}: found reference.kind = "{kind}", wanted "ortho": chips are cut out of an orthoimage'
        )
    require_new_folder(folder)


def seen_of(landmarks: Landmarks, names: Sequence[str]) -> Landmarks:
    """Those landmarks that are named."""
    seen = set(names)
    chosen = np.array([name in seen for name in landmarks.ids])
    return replace(
        landmarks,
        ids=tuple(name for name in landmarks.ids if name in seen),
        r_J=landmarks.r_J[chosen],
        covariance_J=landmarks.covariance_J[chosen],
        sources=None,
    )
