"""A calibration in a table and some lines: what the terminal shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...estimators.protocol import Status
from ...judge.calibrate import Calibration
from ...judge.parameters.separability import known, of_camera
from ...judge.trust import NORMAL_95
from ...physics import so3
from ...physics.units import ARCSEC
from ...table.parameter_names import UNITS, unit_of
from ..page import Table
from ..text import counted

if TYPE_CHECKING:
    from ...identify.labelling import Labels

Array = NDArray[np.float64]

WIDER = 1.25
"""Half-width of a 95 % interval over 1.96 of the larger sigmas from which on the table shows it."""


def summary_table(c: Calibration, C_EK_true: Array | None) -> Table:
    """Correction and sigma about the star tracker's axes, the truth beside them where it is known."""
    lost, half = c.status in (Status.REFUTED, Status.NOT_CONVERGED), c.interval_95_E
    sigma = None if lost else c.sigma_E
    no_sigma = ("not valid" if lost else "not stated",) * 3
    rows = [("correction", *(("not valid",) * 3 if lost else _fixed(c.correction_E / ARCSEC)))]
    of_sigma = [("sigma", *(no_sigma if sigma is None else _fixed(sigma / ARCSEC)))]
    data = None if c.from_data is None else c.from_data.sigma_E
    if data is not None and sigma is not None:
        first = bool(np.any(data > sigma))  # the larger leads
        of_sigma.insert(0 if first else 1, ("sigma from the data", *_fixed(data / ARCSEC)))
    rows += of_sigma
    if half is not None and (c.status is Status.WEAK or _wider(half, c.leading_sigma_E)):
        rows.append(("95 % interval, +-", *_fixed(half / ARCSEC)))
    if C_EK_true is not None and not lost:
        error = so3.log(c.estimate.C_EK @ C_EK_true.mT)
        rows.append(("known truth", *_fixed(so3.log(C_EK_true @ c.campaign.C_EK.mT) / ARCSEC)))
        rows.append(("error (rotation)", *_fixed(error / ARCSEC)))
        if sigma is not None:
            rows.append(("error / sigma", *_fixed(error / sigma, 2)))
    return Table(f"Alignment of {c.campaign.name}", ("arcsec about", "x", "y", "z"), rows)


def _wider(half_E: Array, sigma_E: Array | None) -> bool:
    """Whether half-widths of 95 % intervals are not what a reader takes a sigma for."""
    return sigma_E is not None and bool(np.any(half_E > WIDER * NORMAL_95 * sigma_E))


def _fixed(values: Array, places: int = 3) -> tuple[str, ...]:
    return tuple(f"{value:.{places}f}" for value in values)


_WITH = {"sighting": "alone", "image as a whole": "with an image", "landmark as a whole": "with a landmark"}
"""How a sighting was rejected, by the first words of its reason."""


def summary_sentences(c: Calibration) -> list[str]:
    """Counts, status, fit and geolocation, a line each."""
    used = c.residuals.used
    images = np.unique(c.campaign.sightings.image[used]).size
    lines = [
        f"{counted(images, 'image')}, {counted(int(np.sum(used)), 'observation')}; status {c.status.name.lower()}"
    ]
    if c.estimate.chi2 is not None and c.chi2_p is not None and c.estimate.degrees_of_freedom is not None:
        dof = int(c.estimate.degrees_of_freedom)
        lines.append(
            f"chi-square {float(c.estimate.chi2):.1f} for {dof} degrees of freedom (p = {c.chi2_p:.3g})"
        )
    for check, name in ((False, "control point"), (True, "check point")):
        before, after = c.accuracy(False, check), c.accuracy(True, check)
        if after is not None:
            was = "off the Earth" if before is None else f"{before.rmse:.3g} m"
            of_left_out = _checks_of_left_out(c) if check else 0
            more = f"; {of_left_out} more of images that are left out" if of_left_out else ""
            lines.append(
                f"geolocation of {counted(after.n, name)}: {was} rms before, {after.rmse:.3g} m after "
                f"(CE90 {after.ce90:.3g} m){more}"
            )
    if c.rejected:
        kinds = [r.reason.split(":")[0] for r in c.rejected]
        several = ", ".join(f"{kinds.count(kind)} {_WITH.get(kind, kind)}" for kind in dict.fromkeys(kinds))
        counts = f" ({several})" if len(set(kinds)) > 1 else ""
        lines.append(f"rejected {counted(len(c.rejected), 'sighting')}{counts}: see result.json")
    return lines


def _checks_of_left_out(c: Calibration) -> int:
    """How many check points are of images that the answer leaves out."""
    s = c.campaign.sightings
    return int(np.sum(s.check & c.campaign.landmarks.surveyed[s.landmark] & ~c.check))


def label_sentence(labels: Labels) -> str:
    """How many detections were matched with a landmark, and why the others were not."""
    counts = labels.counts
    return (
        f"{counts['labelled']} of {counts['detections']} detections named; {counts['no_landmark']} fit no landmark, "
        f"{counts['ambiguous']} more than one"
    )


def parameter_sentences(c: Calibration) -> list[str]:
    """What was estimated beside the alignment, a line each."""
    p = c.estimate.parameters
    if p is None:
        return []
    lines = []
    sigma = np.sqrt(np.diagonal(p.covariance))[3:]
    trusted = known(p, list(c.combinations))
    for name, value, spread, good in zip(p.names, p.values, sigma, trusted, strict=True):
        if of_camera(name):
            continue  # these stand in a table of their own
        unit = unit_of(name)
        number = f"{value / UNITS[unit]:+.4g} +- {spread / UNITS[unit]:.2g} {unit}".rstrip()
        lines.append(f"{name}: {number if good else 'not known from these data'}")
    return lines
