"""Whether and how the mounting of a campaign moves: the tests, the motion where there is one, and what to say of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...estimators.fit import Fit
from ...physics.units import ARCSEC
from ...table.campaign import Campaign
from ...table.phases import Phases, phases
from ..trust import NORMAL_95, Finding, probability
from .averaging import Motion, averaged, structures
from .directed import FOUND_P, LARGER_P, DirectedTest, directed_tests, headline
from .regressors import LINEAR, MEAN, ORBIT, STEP, TEMPERATURE, Scales, When, families
from .sums import ImageSums, image_sums

Array = NDArray[np.float64]

FEWEST = 4
"""Images from which a motion can be tested."""
ROUND = 72
"""Phases of the orbit at which the mounting is looked at."""


@dataclass(frozen=True)
class Moves:
    """What the images say of a mounting that moves: the ``tests``, the most likely motion first, and ``detectable``
    rad, the amplitude that they would find; ``motion`` about the answer, where a test finds one or it is ``asked`` for;
    ``further_E`` (3, 3) rad^2 is what it adds to the answer's covariance."""

    sums: ImageSums
    when: When
    scales: Scales
    families: Mapping[str, tuple[tuple[str, ...], ...]]
    tests: tuple[DirectedTest, ...]
    motion: Motion | None = None
    asked: str = "none"
    further_E: Array | None = None

    @property
    def detectable(self) -> float | None:
        return headline(self.tests)

    @property
    def found(self) -> DirectedTest | None:
        """The most likely motion, if it is one."""
        return self.tests[0] if self.tests and self.tests[0].p < FOUND_P else None

    @property
    def unseen_E(self) -> Array | None:
        """Covariance (3, 3) rad^2 of a steady change over the span that the images leave possible; None where they
        tell none."""
        if LINEAR not in self.families:
            return None
        M, _ = self.sums.scaled(variance_of(self.tests)).equations(
            self.scales.columns((MEAN, LINEAR), self.when)
        )
        return np.asarray(np.linalg.inv(M)[3:, 3:])


def moves(campaign: Campaign, fit: Fit, where: Phases | None = None) -> Moves | None:
    """Tests of the images used in an adjustment; None for too few of them."""
    sums = image_sums(fit)
    if sums is None or sums.size < FEWEST:
        return None
    where = where or phases(campaign)
    when = when_of(campaign, where, sums.image)
    scales = Scales.of(when, where.orbit if np.all(np.isfinite(when.u)) else None)
    tried = families(when, scales)
    tests = directed_tests(sums, when, scales, tried)
    if not tests:
        return None
    found = Moves(sums, when, scales, tried, tests)
    if found.found is None:
        return found
    motion = averaged(sums, when, scales, structures(tried), variance_of(tests))
    return Moves(sums, when, scales, tried, tests, motion)


def when_of(campaign: Campaign, where: Phases, image: NDArray[np.int64]) -> When:
    """Of some images."""
    images = campaign.images
    return When(
        images.t_ns[image], where.u[image], {name: x[image] for name, x in images.temperatures.items()}
    )


def variance_of(tests: tuple[DirectedTest, ...]) -> float:
    """Variance between images over what is stated, as the motion that explains most leaves it; 1 where it may be."""
    from ...solve.probability import chdtrc

    least = min(tests, key=lambda test: test.between)
    return least.between if chdtrc(least.freedom, least.between * least.freedom) < LARGER_P else 1.0


def finding_of(found: Moves | None, covariance_E: Array | None, *, taken_out: bool = False) -> Finding | None:
    """What to say of a motion that nobody asked to estimate, and from which size on one would be found; None where
    nothing is tested.  ``taken_out`` tells whether a motion is out of the attitudes already."""
    if found is None or found.detectable is None or covariance_E is None:
        return None
    if found.found is None or found.motion is None:
        if taken_out:
            return None
        return Finding(f"no motion of the mounting is found; {would_be_found(found)}", False)
    away = reach(found.motion, found.when)
    size, sigma, axis = surest(found.motion, found.when)
    stated = NORMAL_95 * np.sqrt(np.diagonal(covariance_E))
    cure = "another --drift may estimate it" if taken_out else "--drift auto estimates the motion"
    how = f"{'besides, ' if taken_out else ''}{described(found.found.columns)} ({probability(found.found.p)})"
    return Finding(
        f"the mounting moves {how}: it comes to lie "
        f"{size / ARCSEC:.2g} arcsec (sigma {sigma / ARCSEC:.2g}) about {'xyz'[axis]} from the answer, and the "
        f"interval holds what it does about all axes; {cure}",
        True,
        reach_E=np.maximum(away - stated, 0.0),
    )


def would_be_found(found: Moves) -> str:
    """From which size on a motion is found, in words."""
    sine = any(test.name == f"{ORBIT}:1" for test in found.tests)
    if found.detectable is None:
        return "none could be, in these images"
    where = "with the orbit" if sine else "over the span"
    return f"one of {found.detectable / ARCSEC:.2g} arcsec or more {where} would be"


def reach(motion: Motion, when: When) -> Array:
    """How far (3,) rad the mounting comes to lie from the answer, at the images and all around the orbit, with
    95 % probability."""
    d, sigma = _turns(motion, when)
    return np.asarray(np.max(np.abs(d) + NORMAL_95 * sigma, axis=0))


def surest(motion: Motion, when: When) -> tuple[float, float, int]:
    """How far, rad, it comes to lie from the answer about the axis and at the place where that is the most sigmas, the
    sigma there, and the axis."""
    d, sigma = _turns(motion, when)
    i, axis = np.unravel_index(np.argmax(np.abs(d) / np.maximum(sigma, 1e-300)), d.shape)
    return float(np.abs(d[i, axis])), float(sigma[i, axis]), int(axis)


def _turns(motion: Motion, when: When) -> tuple[Array, Array]:
    """Rotations (n, 3) rad from the answer at the images and around the orbit, and their sigmas."""
    places = [when]
    if any(name.startswith(ORBIT) for name in motion.names):
        places.append(around(motion.scales))
    found = [motion.at(place) for place in places]
    P = np.concatenate([P for _, P in found])
    return np.concatenate([d for d, _ in found]), np.sqrt(np.diagonal(P, axis1=1, axis2=2))


def around(scales: Scales) -> When:
    """Once around the orbit, in the middle of the images' span."""
    u = 2.0 * np.pi * np.arange(ROUND) / ROUND
    middle = {name: np.full(ROUND, centre) for name, (centre, _) in scales.temperatures.items()}
    return When(np.full(ROUND, scales.first_ns + scales.span_ns // 2), u, middle)


def described(columns: tuple[str, ...]) -> str:
    """A motion by its columns, in words."""
    kind, _, which = columns[0].partition(":")
    if kind == ORBIT:
        order = len(columns) // 2
        return "with the orbit" + ("" if order == 1 else f", harmonics 1 to {order}")
    return {
        MEAN: "not at all",
        LINEAR: "steadily over the span of the images",
        STEP: f"by a step about {which} UTC",
        TEMPERATURE: f"with the temperature {which}",
    }[kind]
