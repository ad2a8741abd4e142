"""Which combinations of what was estimated the data can tell apart, in words.

With N the information of the estimate, each quantity alone (all others known) has the sigma ``1 / sqrt(N_ii)``.  In
these units N has ones on its diagonal, and an eigenvector with a small eigenvalue l is a combination whose sigma is
``1 / sqrt(l)`` times larger than that of its members alone: they trade against each other.  The alignment is looked at
about the axes of flight (roll along the track, pitch across it, yaw about the line of sight), in which people think.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...estimators.protocol import AlignmentEstimate, ParameterVector, Status
from ...table.cameras.mounting import CAMERA_MOUNTING
from ...table.observations import Observations
from ..trust import Finding

Array = NDArray[np.float64]

WORTH_SAYING = 10.0
"""Growth of a sigma by another unknown from which it is worth saying."""
UNKNOWN = 30.0
"""Growth from which a member of the combination is no longer reported as known: small model errors then decide."""
HOPELESS = 1000.0
"""Growth from which an alignment that takes part must not be used."""
BOUNDLESS = 3.0
"""Residuals over what is stated from which on an alignment that is not separated from a parameter is anywhere."""
YAW = 2
"""The last of the indices of the alignment in a combination."""
GROWN = 1.1
"""Growth of a sigma by the noise of the lens from which on it is told."""
NO_GAIN = 0.95
"""Share of its prior sigma above which a parameter has gained nothing from the data."""
MEMBER = 0.3
"""Share of the largest component from which a quantity belongs to a combination."""

WORDS = {
    "focal_length": "the focal length",
    "principal_column": "the principal point's column",
    "principal_row": "the principal point's row",
    "time_offset": "the time offset",
    "time_offset_attitude": "the time offset against the attitude",
    "time_offset_orbit": "the time offset against the orbit",
}
TURNS = ("the roll of the alignment", "the pitch of the alignment", "the yaw of the alignment")


@dataclass(frozen=True)
class Combination:
    """Quantities that trade against each other: indices into (roll, pitch, yaw, parameters...), and the growth of their
    sigma."""

    members: tuple[int, ...]
    names: tuple[str, ...]
    growth: float

    @property
    def sentence(self) -> str:
        listed = " and ".join(
            [", ".join(self.names[:-1]), self.names[-1]] if len(self.names) > 1 else self.names
        )
        verb = "can hardly separate" if self.growth < UNKNOWN else "cannot separate"
        return (
            f"the data {verb} {listed}: each is {self.growth:.2g} times less certain than if the others were known"
            + ("" if self.growth < UNKNOWN else ", so none of them is reported as known")
        )


def flight_axes(o: Observations, C_EK: Array) -> Array:
    """Roll, pitch and yaw axes as columns in E (3, 3): the mean motion of the camera, and its line of sight."""
    v_E = np.einsum("...nij,...nj->...i", o.C_EJ, o.v_J) / o.n
    z = C_EK[:, 2]
    x = v_E - z * (z @ v_E)
    length = np.linalg.norm(x)
    # a camera that does not move, or images turned every way, has no track: rows then stand for it
    x = x / length if length > 0.1 * np.linalg.norm(v_E) > 0.0 else C_EK[:, 1]
    return np.stack([x, np.cross(z, x), z], axis=-1)


def combinations(o: Observations, estimate: AlignmentEstimate) -> list[Combination]:
    """Combinations worth saying, the worst first (no batch axes); none without further parameters.

    Mountings of further cameras are none: cameras that see the same attitude have its error in common, as they should.
    """
    p = estimate.parameters
    if p is None or not np.all(np.isfinite(p.covariance)):
        return []
    own = np.array([0, 1, 2, *(i for i, name in enumerate(p.names, start=3) if not of_camera(name))])
    if own.size == 3:
        return []
    covariance = p.covariance if p.straight is None else p.straight
    turn = np.eye(own.size)
    turn[:3, :3] = flight_axes(o, estimate.C_EK)
    N = turn.mT @ np.linalg.inv(covariance[np.ix_(own, own)]) @ turn
    alone = 1.0 / np.sqrt(np.diagonal(N))
    values, vectors = np.linalg.eigh(N * alone[:, None] * alone[None, :])
    words = [*TURNS, *(in_words(p.names[i - 3]) for i in own[3:])]
    found: list[Combination] = []
    for value, vector in zip(values, np.abs(vectors.mT), strict=True):
        growth = float(1.0 / np.sqrt(max(float(value), 1e-30)))
        if growth >= WORTH_SAYING:
            members = np.flatnonzero(vector >= MEMBER * np.max(vector))
            if any(np.array_equal(own[members], other.members) for other in found):
                continue  # two directions of the same quantities: the worse one says it
            found.append(Combination(tuple(own[members].tolist()), tuple(words[i] for i in members), growth))
    return found


def in_words(name: str) -> str:
    """A parameter's name in words."""
    if name.startswith("tracker_"):
        return f"the mounting of tracker {name[8:-2]} about {name[-1]}"
    if of_camera(name):
        return f"the mounting of camera {name[7:-2]} about its {name[-1]}"
    if name.startswith("look_"):
        return f"the look angles' {name[5]} term of degree {name[7:]}"
    return WORDS.get(name, f"the distortion {name}")


def of_camera(name: str) -> bool:
    """Whether a parameter is of the mounting of a further camera."""
    return name.startswith(CAMERA_MOUNTING)


def undetermined_cameras(p: ParameterVector) -> list[Finding]:
    """Cameras whose own markers do not determine their mounting."""
    good = known(p, [])
    lost = dict.fromkeys(
        name[7:-2] for name, told in zip(p.names, good, strict=True) if of_camera(name) and not told
    )
    return [
        Finding(
            f"the mounting of camera {name} is not determined: wanted at least two markers well apart in its images",
            True,
        )
        for name in lost
    ]


def without_gain(p: ParameterVector) -> list[str]:
    """Sentences about parameters of which the data say no more than was known beforehand."""
    sigma = np.sqrt(np.diagonal(p.covariance)[3:])
    return [
        f"the data add nothing to what was known of {in_words(name)}: its sigma is the one stated beforehand"
        for name, new, old in zip(p.names, sigma, p.prior_sigma, strict=True)
        if new > NO_GAIN * old
    ]


def known(p: ParameterVector, found: list[Combination]) -> NDArray[np.bool_]:
    """Which parameters (p,) may be reported: in no inseparable combination, and with a sigma well below its range."""
    sigma = np.sqrt(np.diagonal(p.covariance)[3:])
    good = sigma < 0.3 * p.range
    for combination in found:
        if combination.growth >= UNKNOWN:
            good[[i - 3 for i in combination.members if i >= 3]] = False
    return np.asarray(good)


def ruins_alignment(found: list[Combination]) -> bool:
    """Whether the alignment takes part in a combination that says nothing of it."""
    return any(c.growth >= HOPELESS and min(c.members) < 3 for c in found)


def inseparable(c: Combination, estimate: AlignmentEstimate) -> Finding:
    """What a combination means: small errors of the model decide about it, and large residuals leave no bound."""
    weakens = c.growth >= UNKNOWN
    dof = 0 if estimate.degrees_of_freedom is None else int(estimate.degrees_of_freedom)
    misfit = 0.0 if estimate.chi2 is None or dof == 0 else float(np.sqrt(estimate.chi2 / dof))
    if not weakens or misfit < BOUNDLESS or min(c.members) > YAW:
        return Finding(c.sentence, weakens)
    worse = (
        f"{c.sentence}; with residuals {misfit:.2g} times what is stated nothing bounds the alignment's error"
    )
    return Finding(f"{worse}: run starplumb diagnose", True, refutes=True)


def of_combinations(found: Sequence[Combination], estimate: AlignmentEstimate) -> list[Finding]:
    """What combinations that the data hardly separate mean, and what a lens that is mostly noise did to the sigmas."""
    told = [*(inseparable(combination, estimate) for combination in found), *_of_lens(estimate)]
    p = estimate.parameters
    usable = p is not None and Status(int(estimate.status)).usable
    return [*told, *undetermined_cameras(p)] if usable and p is not None else told


def _of_lens(estimate: AlignmentEstimate) -> list[Finding]:
    """How much larger the sigmas are than those by the normal equations, where that is worth saying."""
    p = estimate.parameters
    if p is None or p.straight is None:
        return []
    growth = float(np.max(np.sqrt(np.diagonal(p.covariance) / np.diagonal(p.straight))[:3]))
    if growth < GROWN:
        return []
    return [
        Finding(
            f"what is estimated of the lens is mostly noise: the sigmas, which hold that, are up to {growth:.2g} times "
            "those of the normal equations, which take it for known",
            False,
        )
    ]
