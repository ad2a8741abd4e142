"""What a calibration found: the answer, its residuals as a table, its figures and its files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ..disk.publish import Content
from ..documents.from_calibration import RESULT_SCHEMA, requirement_document, result_document
from ..io.campaign.read import LoadedCampaign
from ..io.results.residual_table import residual_columns, residual_names
from ..judge.accuracy.requirement import Met, Requirement, met
from ..judge.calibrate import Calibration
from ..judge.mountings import mountings
from ..judge.trust import IMPLAUSIBLE_P
from ..physics.errors import AlignmentFailed
from ..physics.units import ARCSEC
from ..report.calibration.summary import label_sentence, parameter_sentences, summary_sentences, summary_table
from ..report.cameras import tables_of_cameras
from ..report.page import Table
from .arguments import Folder, checked
from .campaign import Campaign
from .frames import Frame
from .motion.kernels import MOVING_FILES, KernelFrames, moving_kernels
from .show import Shown, for_python

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..identify.labelling import Labels

Array = NDArray[np.float64]

MAP = "residuals.gpkg"
"""The residuals for a geographic information system."""
PDF = "report.pdf"
"""The report to print."""
RESULT = "result.json"
MARK = (RESULT, RESULT_SCHEMA)
"""The mark of the set and its kind: it is written last and has the digests of the others."""
RESULT_FILES = ("report.html", PDF, "mounting.tf", "residuals.csv", "normals.json", MAP, *MOVING_FILES)
"""Files of a result beside ``result.json``: those that a new result does not write are removed."""


@dataclass(frozen=True, repr=False, eq=False)
class Result(Shown):
    """The answer of one calibration: what :func:`starplumb.calibrate` returns.

    ``calibration`` is the plain data that everything here is taken from, in SI units and radians; ``method`` is what
    was asked for; ``labels`` says which landmark each detection was matched with, None where they were known;
    ``requirement`` is what the accuracy must be, None for nothing.
    """

    made_by: ClassVar[str] = "calibrate"

    campaign: Campaign
    calibration: Calibration
    method: str
    labels: Labels | None = None
    requirement: Requirement | None = None

    @property
    def C_EK(self) -> Array:
        """The mounting (3, 3), from the camera to the star tracker: ``v_E = C_EK @ v_K``; the model's if refuted."""
        return self.calibration.C_EK

    @property
    def correction_arcsec(self) -> Array:
        """The correction d (3,) about x, y, z of the star tracker: ``C_EK = exp(d) @ C_EK_model``."""
        return np.asarray(self.calibration.correction_E / ARCSEC)

    @property
    def sigma_arcsec(self) -> Array | None:
        """The standard deviation (3,) of the mounting's error about x, y, z of the star tracker.

        None where the method states none, or where the data refute the answer.
        """
        sigma = self.calibration.sigma_E
        return None if sigma is None else np.asarray(sigma / ARCSEC)

    @property
    def covariance_arcsec2(self) -> Array | None:
        """The covariance (3, 3) of that error; None likewise."""
        covariance = self.calibration.covariance_E
        return None if covariance is None else np.asarray(covariance / ARCSEC**2)

    @property
    def interval_95_arcsec(self) -> Array | None:
        """Half-widths (3,) of the 95 % intervals, widened by all that was found; None likewise."""
        half = self.calibration.interval_95_E
        return None if half is None else np.asarray(half / ARCSEC)

    @property
    def sigma_from_data_arcsec(self) -> Array | None:
        """The standard deviation (3,) by the scatter of the images, whatever is stated; None where it cannot tell."""
        found = self.calibration.from_data
        return None if found is None or found.sigma_E is None else np.asarray(found.sigma_E / ARCSEC)

    @property
    def status(self) -> str:
        """``ok``, ``weak`` (usable within ``interval_95_arcsec``, see ``message``), ``refuted``, ``singular`` or
        ``not_converged``."""
        return self.calibration.status.name.lower()

    @property
    def usable(self) -> bool:
        """Whether the mounting may be used."""
        return self.calibration.status.usable

    @property
    def message(self) -> str:
        """What weakens the answer or should be known about it, in one line; empty where there is nothing."""
        return for_python(self.calibration.message)

    def raise_if_unusable(self) -> None:
        """Raise AlignmentFailed, with the message, where the mounting must not be used."""
        if not self.usable:
            raise AlignmentFailed(f"{self.campaign.source}: {self.message}")

    @cached_property
    def document(self) -> dict[str, Any]:
        """``result.json`` as a dictionary."""
        loaded = self.campaign.loaded
        document = result_document(
            self.calibration,
            self.method,
            self.campaign.frames,
            loaded.inputs,
            _provenance(loaded),
            loaded.C_EK_true,
        )
        if self.labels is not None:
            document["labels"] = self.labels.counts
        if self.met is not None:
            document["requirement"] = requirement_document(self.met)
        return document

    @property
    def met(self) -> Met | None:
        """Whether the requirement is met, with what was found; None where nothing was required."""
        return None if self.requirement is None else met(self.calibration, self.requirement)

    @property
    def parameters(self) -> list[dict[str, Any]]:
        """What was estimated beside the alignment: name, unit, correction, sigma and the sigma before."""
        return list(self.document.get("parameters", ()))

    @property
    def residuals(self) -> Frame:
        """Every observation with its residuals: the columns of ``residuals.csv``."""
        columns = residual_columns(self.calibration, self.campaign.loaded.shift_px)
        return Frame("Residuals", tuple(residual_names(self.calibration)), tuple(columns))

    @property
    def tables(self) -> Sequence[Table]:
        return (
            summary_table(self.calibration, self.campaign.C_EK_true),
            *tables_of_cameras(self.calibration),
        )

    @property
    def sentences(self) -> Sequence[str]:
        c = self.calibration
        named = [] if self.labels is None else [label_sentence(self.labels)]
        required = [] if self.met is None else [self.met.sentence]
        found = (*named, *summary_sentences(c), *required, *parameter_sentences(c))
        return (*found, *(f"note: {text}" for text in c.sentences))

    @cached_property
    def normals(self) -> dict[str, Any] | None:
        """``normals.json`` as a dictionary: additive normal equations; None where the answer cannot be used, where the
        method's equations are not known, and where they are too many."""
        from ..documents.normals import normals_document

        return normals_document(self.calibration)

    @property
    def implausible(self) -> bool:
        """Whether the residuals are too large for the stated sigmas: :func:`starplumb.diagnose` may say why."""
        p = self.calibration.chi2_p
        return p is not None and p < IMPLAUSIBLE_P

    def report(self) -> str:
        """``report.html``: one page with tables and figures, which needs no other file."""
        from ..report.calibration.page import calibration_page

        return calibration_page(self.calibration, self.document)

    @checked
    def save(self, folder: Folder, report: bool = True, gpkg: bool = False, pdf: bool = False) -> None:
        """Write what ``starplumb calibrate --out`` writes, all files or none.

        ``result.json``, ``residuals.csv``, with ``report`` the page ``report.html``, with ``pdf`` the same page as
        ``report.pdf`` (by WeasyPrint or a browser), with ``gpkg`` the map ``residuals.gpkg``, and, if the mounting may
        be used, the SPICE frame kernel ``mounting.tf``.  One that moves is also a table ``mounting.csv`` with its
        covariance and, with the extra ``spice``, a C-kernel ``mounting.bc`` with its clock ``mounting.tsc``.
        ``result.json`` is written last and names the others with their digests.
        Files of an earlier result that this one does not write are removed; no other file is replaced.
        """
        from ..io.text.write import csv_pieces, json_text, marked, publish
        from ..report.pdf import require_printer, write_pdf

        if pdf:
            require_printer()

        residuals = self.residuals
        files: dict[str, Content] = {"residuals.csv": csv_pieces(residuals.names, residuals.columns)}
        if (normals := self.normals) is not None:
            files["normals.json"] = json_text(normals)
        if self.labels is not None:
            from ..io.results.labels import label_files

            files |= label_files(self.campaign.loaded, self.labels)
        if report or pdf:
            page = self.report()
            files |= {"report.html": page} if report else {}
            files |= {PDF: partial(write_pdf, page)} if pdf else {}
        if self.usable:
            files["mounting.tf"] = self._kernel()
        moving = moving_kernels(self.calibration, self._kernel, self._frames) if self.usable else None
        if moving is not None:
            files |= moving.files
        if gpkg:
            files[MAP] = self._write_map
        mark, inputs = marked(RESULT, self.document), self.campaign.loaded.sources
        publish(Path(folder), files, instead_of=RESULT_FILES, mark=mark, inputs=inputs)

    @property
    def _frames(self) -> KernelFrames:
        """SPICE's names of camera and tracker, and the ids."""
        from ..io.campaign.spice_config import kernel_frames

        spice, cameras = self.campaign.loaded.config.spice, self._cameras
        first = next(iter(cameras.values())) if cameras else None
        return kernel_frames(spice, self.campaign.frames[1], first)

    @property
    def _cameras(self) -> dict[str, tuple[str, int]]:
        """SPICE's names and ids of cameras that have names, by these."""
        from ..io.campaign.spice_config import camera_frames
        from ..io.formats.spice_names import TRACKER_ID

        config = self.campaign.loaded.config
        stated = {each.name: each.spice for each in config.cameras or ()}
        return camera_frames(stated, config.spice.tracker.id or TRACKER_ID)

    def _kernel(self, clock: int | None = None) -> str:
        from ..io.formats.spice import FurtherCamera, frame_kernel_text

        found, others = mountings(self.calibration), list(self._cameras.values())
        further = [
            FurtherCamera(*others[k], found.C_EC[k], found.covariance_of(k))
            for k in range(1, len(others))
            if found is not None and found.known[k]
        ]
        camera, tracker, ids = self._frames
        heading = (("campaign", self.campaign.name), ("method", self.method), ("status", self.status))
        return frame_kernel_text(
            self.C_EK,
            camera,
            tracker,
            ids=ids,
            covariance_E=self.calibration.estimate.covariance_E,
            comments=[f"{key}: {value}" for key, value in heading],
            clock=clock,
            further=further,
        )

    def _write_map(self, path: Path) -> None:
        """The residuals at their landmarks as a layer of points."""
        from ..io.gis.geopackage import write_residuals
        from ..physics.earth import itrf_to_geodetic
        from ..physics.units import DEG

        data, residuals = self.campaign.loaded.campaign, self.residuals
        latitude, longitude, _ = itrf_to_geodetic(data.landmarks.r_J[data.sightings.landmark])
        write_residuals(path, latitude / DEG, longitude / DEG, residuals.names, residuals.columns)

    @checked
    def plot_residuals(
        self, where: Literal["image", "ground"] = "image", when: Literal["before", "after"] = "after"
    ) -> Figure:
        """Residuals as arrows over the field of view, px, or over the ground, m."""
        from ..report.calibration.figures import residual_vectors

        return residual_vectors(self.calibration, where, when).drawing

    @checked
    def plot_trend(
        self, against: Literal["time", "latitude", "image"] = "time", shared_errors: bool = True
    ) -> Figure:
        """Residuals after the calibration against time, latitude or image.

        With ``shared_errors`` False less the errors that all markers of an image share, as far as they are estimated.
        """
        from ..report.calibration.figures import trend

        return trend(self.calibration, against, shared_errors).drawing

    def plot_ground(self) -> Figure:
        """East and north errors of every observation after the calibration."""
        from ..report.calibration.figures import ground_scatter

        return ground_scatter(self.calibration).drawing

    @checked
    def plot_alignment(self, axes: Literal["xy", "xz", "yz"] = "xy") -> Figure:
        """The correction with its error ellipses about two axes of the star tracker."""
        from ..report.calibration.figures import alignment_ellipse

        self._require("covariance_arcsec2")
        return alignment_ellipse(self.calibration, axes).drawing

    def plot_budget(self) -> Figure:
        """What each error source contributes to the sigmas."""
        from ..report.calibration.figures import budget

        self._require("budget")
        return budget(self.document).drawing

    def _require(self, key: str) -> None:
        if not self.usable or not self.document.get(key):
            raise AlignmentFailed(
                f"{self.campaign.source}: the method {self.method} gives no "
                f"{key.split('_')[0]} here (status {self.status}), so there is nothing to draw"
            )


def _provenance(loaded: LoadedCampaign) -> dict[str, Any]:
    """Where the Earth's orientation came from, whether it was predicted, and which corrections were on."""
    c = loaded.campaign.corrections
    orientation = loaded.orientation
    named = loaded.config.campaign.satellite
    return {
        **({} if named is None else {"satellite": named}),
        "earth_orientation": None
        if orientation is None
        else {"source": orientation.source, "predicted": loaded.predicted_orientation},
        "corrections": {"light_time": c.light_time, "aberration": c.aberration, "refraction": c.refraction},
        **({"left_out": list(map(asdict, loaded.left_out))} if loaded.left_out else {}),
        "notices": list(loaded.notices),
    }
