"""Does the answer hold together?  Chi-square, geometry and the aberration switch, said in plain sentences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..estimators.protocol import AlignmentEstimate, Estimator, Status
from ..estimators.usable import EXACT
from ..physics import so3
from ..physics.units import ARCSEC, DEG
from ..solve.chunks import CHUNK, part, sample, sampled
from ..table.observations import Observations
from .parameters.known_before import contradicted
from .trust import IMPLAUSIBLE_P, Finding, probability

Array = NDArray[np.float64]

WEAK_RATIO = 20.0
"""The angle about the boresight is reported as weak when its sigma is this many times that of the other two..."""
WEAK_SIGMA = 30.0 * ARCSEC
"""...and larger than this."""
DECISIVE = 12.0
"""Fall of chi-square by which the opposite aberration setting explains the data better (odds of 400 to 1)."""
ABSURD = 100.0
"""Chi-square per degree of freedom from which fits are no reason to prefer one setting: residuals ten times what is
stated."""
INFORMATIVE = 4.0
"""Rise of chi-square under the opposite setting from which on the data confirm the stated one (odds of 7 to 1)."""


def chi2_p(chi2: float, degrees_of_freedom: int) -> float:
    """Probability of a chi-square at least this large when the stated sigmas are right."""
    from ..solve.probability import chdtrc

    return float(chdtrc(degrees_of_freedom, chi2)) if degrees_of_freedom > 0 else 1.0


def findings(
    observations: Observations,
    C_EK_model: Array,
    estimate: AlignmentEstimate,
    estimator: Estimator,
    known_from: str = "mounting.sigma_arcsec",
) -> list[Finding]:
    """All that is worth saying about one estimate (no batch axes) that has a covariance.

    ``observations`` are those the estimate was made from, and ``estimator`` makes it again with another switch;
    ``known_from`` names what states the prior.
    """
    if estimate.covariance_E is None or not Status(int(estimate.status)).usable:
        return []
    found = [
        _one_image(observations),
        _boresight(observations, estimate),
        _chi_square(observations, estimate),
        *contradicted(observations, C_EK_model, estimate, known_from),
    ]
    found.append(_aberration(observations, C_EK_model, estimate, estimator))
    return [finding for finding in found if finding is not None]


def _one_image(o: Observations) -> Finding | None:
    if np.unique(o.image).size > 1:
        return None
    return Finding(
        "only one image: its attitude and position error cannot be separated from the alignment, "
        "and nothing checks their stated sigmas",
        True,
    )


def field_radius(o: Observations) -> float:
    """Rms field angle (rad) of the markers about the centre of those of their own image."""
    counts = np.maximum(np.bincount(o.image, minlength=o.n_images), 1)
    centre = np.stack([np.bincount(o.image, o.xy_K[:, i], o.n_images) for i in range(2)], axis=-1)
    offset = o.xy_K - (centre / counts[:, None])[o.image]
    return float(np.sqrt(np.mean(np.sum(offset**2, axis=-1))))


def boresight_sigmas(C_EK: Array, covariance_E: Array) -> Array:
    """Standard deviations about x, y, z of the camera, rad, of an error stated about E's axes."""
    return np.asarray(np.sqrt(np.diagonal(C_EK.mT @ covariance_E @ C_EK)))


def _boresight(o: Observations, estimate: AlignmentEstimate) -> Finding | None:
    assert estimate.covariance_E is not None
    sigma = boresight_sigmas(estimate.C_EK, estimate.covariance_E)
    across = float(np.max(sigma[:2]))
    if sigma[2] < max(WEAK_RATIO * across, WEAK_SIGMA):
        return None
    return Finding(
        f"the angle about the boresight is known to {sigma[2] / ARCSEC:.0f} arcsec only "
        f"({across / ARCSEC:.2g} arcsec across it): the markers of an image lie within "
        f"{field_radius(o) / DEG:.2g} deg rms of each other; markers farther apart would determine it",
        True,
    )


def _chi_square(o: Observations, estimate: AlignmentEstimate) -> Finding | None:
    if estimate.chi2 is None or estimate.degrees_of_freedom is None:
        return None
    chi2, dof = float(estimate.chi2), int(estimate.degrees_of_freedom)
    if dof <= 0:
        return Finding("no observation is left over to check the stated sigmas", False)
    p = chi2_p(chi2, dof)
    factor = np.sqrt(chi2 / dof)
    if p < IMPLAUSIBLE_P:
        refutes = bool(chi2 > ABSURD * dof)
        meaning = (
            "neither the answer nor its sigma can be believed: run starplumb diagnose"
            if refutes
            else "the interval is widened by it"
        )
        return Finding(
            f"chi-square {chi2:.1f} for {dof} degrees of freedom is implausible ({probability(p)}): the residuals are "
            f"{factor:.2g} times what the stated sigmas allow, so a sigma is too small or something is wrong"
            + (f"; {meaning}" if factor > EXACT else ""),
            bool(factor > EXACT),
            refutes=refutes,
        )
    if p > 1.0 - IMPLAUSIBLE_P:
        return Finding(
            f"chi-square {chi2:.1f} for {dof} degrees of freedom is implausibly small: the residuals are only "
            f"{factor:.2g} times what the stated sigmas allow, so the sigmas are too large",
            False,
        )
    return None


def _absurd(estimate: AlignmentEstimate) -> bool:
    """Whether an estimate fits so badly that its chi-square is no argument."""
    return _factor(estimate) > ABSURD


def _factor(estimate: AlignmentEstimate) -> float:
    """Chi-square per degree of freedom; 0 where the method has none."""
    if estimate.chi2 is None or estimate.degrees_of_freedom is None:
        return 0.0
    return float(estimate.chi2) / max(int(estimate.degrees_of_freedom), 1)


def _aberration(
    o: Observations, C_EK_model: Array, estimate: AlignmentEstimate, estimator: Estimator
) -> Finding | None:
    """Compare with the opposite switch: by chi-square where the views differ enough, else by the correction itself.

    In views that all look the same way the aberration is a constant rotation of about 5 arcsec and disappears in the
    alignment.  Then both corrections are named, and the stated switch is suspected where the opposite one would leave a
    correction smaller by much of that rotation: the sign that the aberration is in twice, or not at all.
    What counts as a gain in chi-square grows with the residuals, where these are larger than stated.
    """
    if estimate.chi2 is None or not np.all(np.any(o.v_J, axis=-1)):
        return None
    if sampled(o) and _confirmed(sample(o), C_EK_model, estimator):
        return None
    stated = o.corrections.aberration
    opposite = estimator(_other_aberration(o), C_EK_model)
    if opposite.chi2 is None or not Status(int(opposite.status)).usable:
        return None
    words = f"aberration = {'true' if stated else 'false'}", f"aberration = {'false' if stated else 'true'}"
    if _absurd(estimate) and _absurd(opposite):
        return None
    gain = float(estimate.chi2 - opposite.chi2) / max(1.0, _factor(opposite))
    if gain > DECISIVE:
        return Finding(
            f"the switch {words[0]} looks wrong: {words[1]} explains the data better "
            f"(chi-square {float(opposite.chi2):.1f} instead of {float(estimate.chi2):.1f})",
            True,
        )
    shift = _across(opposite.C_EK, estimate.C_EK)
    if gain < -INFORMATIVE or shift < 2.0 * ARCSEC:
        return None
    here, there = (_across(C_EK_model, e.C_EK) / ARCSEC for e in (estimate, opposite))
    suspect = there < here - 0.4 * shift / ARCSEC and here < 3.0 * shift / ARCSEC
    return Finding(
        f"the switch {words[0]} {'may be wrong' if suspect else 'cannot be checked'}: with it the correction across "
        f"the boresight is {here:.1f} arcsec, with {words[1]} {there:.1f}, and the data fit equally well; views in "
        "other directions would decide it; so does the description of the attitude product",
        False,
        informs=not suspect,
    )


def _other_aberration(o: Observations) -> Observations:
    """The table with the opposite switch, made a chunk at a time."""
    corrections = replace(o.corrections, aberration=not o.corrections.aberration)
    e_E, row_rate_E, range_m = np.empty(o.e_E.shape), np.empty(o.row_rate_E.shape), np.empty(o.range_m.shape)
    for start in range(0, o.n, CHUNK):
        rows = slice(start, start + CHUNK)
        seen = part(o, rows).with_geometry(corrections=corrections)
        e_E[rows], row_rate_E[rows], range_m[rows] = seen.e_E, seen.row_rate_E, seen.range_m
    return replace(o, corrections=corrections, e_E=e_E, row_rate_E=row_rate_E, range_m=range_m)


def _confirmed(o: Observations, C_EK_model: Array, estimator: Estimator) -> bool:
    """Whether the stated switch explains a sample of a large table decisively better than the opposite one."""
    here, there = (estimator(table, C_EK_model) for table in (o, _other_aberration(o)))
    if here.chi2 is None or there.chi2 is None:
        return False
    usable = Status(int(here.status)).usable and Status(int(there.status)).usable
    return usable and float(there.chi2 - here.chi2) > DECISIVE


def _across(C_EK_a: Array, C_EK_b: Array) -> float:
    """Angle between the boresights of two mountings, rad."""
    return float(np.linalg.norm(so3.log(C_EK_a.mT @ C_EK_b)[..., :2]))
