"""Measuring surveyed lights, discs and crosses: sightings, or detections where it is not known which is which."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...imagery.chain import Wanted
from ...imagery.targets.chain import Targets, TargetScene, measure_targets
from ...imagery.targets.fit import Noise
from ...imagery.targets.shape import Shape
from ...io.campaign.marks.landmarks import read_landmarks
from ...io.campaign.read import LoadedImages
from ...io.campaign.table_config import LandmarksConfig
from ...io.campaign.write import landmarks_text
from ...io.imagery.config import ImageryConfig, ReferenceConfig
from ...io.imagery.kept import KeptImages
from ...io.imagery.scene import open_raws
from ...io.text.files import fingerprint
from ...report.text import counted
from .measurement import Measurement

if TYPE_CHECKING:
    from ...disk.publish import Content

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False, eq=False)
class TargetMeasurement(Measurement):
    """What :func:`starplumb.measure` found of targets; ``targets`` says whether each is known by name."""

    targets: Targets | None = None

    @property
    def labelled(self) -> bool:
        return self.targets is not None and self.targets.labelled

    @property
    def marks_name(self) -> str:
        return "observations" if self.labelled else "detections"

    @property
    def sentences(self) -> Sequence[str]:
        out = [f"{self._name(image)} left out: {image.reason}" for image in self.images if image.reason]
        used = sum(len(image.used) for image in self.images if not image.reason)
        out.append(
            f"{counted(used, 'target')} of {self.acquired} of {counted(len(self.images), 'image')} measured"
        )
        if not self.labelled:
            out.append("which target is which cannot be told: they are detections, for calibrate to name")
        return [*out, *self._noise()]

    def _noise(self) -> list[str]:
        """What the images told of their noise, where it is not stated."""
        told = [] if self.targets is None else [noise for noise in self.targets.noise if noise is not None]
        if not told or self._imagery.read_noise_dn is not None:
            return []
        dark = float(np.median([np.sqrt(noise.floor) for noise, _ in told]))
        gain = float(np.median([noise.dn_per_electron for noise, _ in told]))
        return [
            f"noise as the images tell it: {dark:.3g} DN of the background, {gain:.3g} DN an electron of the targets "
            "(imagery.read_noise_dn and dn_per_electron state it)"
        ]

    def _tables(self) -> dict[str, Content]:
        if self.labelled:
            return super()._tables()
        landmarks = self.loaded.campaign.landmarks
        return {"landmarks.csv": landmarks_text(landmarks), "detections.csv": self.marks.detections()}

    @property
    def _imagery(self) -> ImageryConfig:
        assert self.loaded.config.imagery is not None
        return self.loaded.config.imagery


def measure_targets_of(
    path: Path,
    loaded: LoadedImages,
    prior_E: Array,
    own_E: Array,
    tell: Callable[[int, int], None],
    keep: Callable[[LoadedImages], KeptImages | None] = lambda loaded: None,
) -> TargetMeasurement:
    """The targets of a campaign with [reference] kind = "points"; ``keep`` says where finished images of one that is
    read are kept."""
    config = loaded.config
    assert config.imagery is not None
    assert config.reference is not None
    table = loaded.folder / config.reference.files[0]
    notices = list(loaded.notices)
    stated = LandmarksConfig(file=config.reference.files[0], sigma_m=config.reference.sigma_m)
    landmarks = read_landmarks(table, notices, declared=stated.declared("reference"))
    landmarks = replace(landmarks, correlation_length=config.reference.correlation_length_m)
    loaded = replace(
        loaded,
        campaign=replace(loaded.campaign, landmarks=landmarks),
        notices=tuple(notices),
        inputs=loaded.inputs | {config.reference.files[0]: fingerprint(table)},
        sources=(*loaded.sources, table),
    )
    scene = target_scene(str(path), loaded, config.imagery, config.reference)
    wanted = Wanted(check_share=config.measure.check_share)
    total, kept = len(scene.raws), keep(loaded)
    found = measure_targets(scene, prior_E, own_E, wanted, lambda done: tell(done, total), kept)
    return TargetMeasurement(path, loaded, scene, found.images, kept, found)


def target_scene(
    settings: str, loaded: LoadedImages, imagery: ImageryConfig, reference: ReferenceConfig
) -> TargetScene:
    """Raw images, landmarks, what these look like and the camera's noise."""
    noise = None
    if imagery.read_noise_dn is not None and imagery.dn_per_electron is not None:
        # whole numbers add a twelfth
        noise = Noise(imagery.read_noise_dn**2 + 1.0 / 12.0, imagery.dn_per_electron)
    raws = open_raws(settings, loaded.campaign, loaded.folder, imagery)
    return TargetScene(
        loaded.campaign, raws, _shape(reference), noise, not reference.dark, imagery.saturation_dn
    )


def _shape(reference: ReferenceConfig) -> Shape:
    size = reference.size_m or ()
    if reference.shape == "disc":
        return Shape.disc(size[0])
    return Shape.cross(size[0], size[1]) if reference.shape == "cross" else Shape.light()
