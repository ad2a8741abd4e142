"""Tests directed at motions of a mounting: each a regression of the images' own rotations, and what it would find.

With the equations (M, v) of a constant and q columns beside it, and those of the constant alone (M_0, v_0), of the 3 m
numbers that m images tell::

    T = v^T M^-1 v - v_0^T M_0^-1 v_0          chi-square of 3 q numbers, if the mounting rests
    S = own rotations - v^T M^-1 v             what is left between images, of n = 3 m - 3 (1 + q) degrees of freedom

Stated sigmas may be too small, which must raise no alarm, and small by chance, which must raise none either: p is the
larger of those of T and of ``F = (T / 3 q) / (S / n)``.  Bonferroni's bound over all that is tried makes it the
probability of any such finding in a campaign whose mounting rests.  The detectable amplitude is that which the test
finds with 90 % probability by the noncentral F distribution, about each axis at once, its phases or signs at random.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .regressors import LINEAR, MEAN, ORBIT, STEP, Scales, When
from .sums import ImageSums

Array = NDArray[np.float64]

FOUND_P = 0.01
"""Corrected probability below which a motion is found."""
POWER = 0.9
"""Probability with which a motion of the detectable amplitude is found."""
LARGER_P = 0.01
"""Probability of the scatter between images below which the detectable amplitude is that of the scatter, not of the
stated errors."""
SHIFTS = 8
"""Relative phases, or signs, of the three axes over which the detectable amplitude is averaged, in each direction."""


@dataclass(frozen=True)
class DirectedTest:
    """One test: its name, the best of its alternatives (the step of smallest p), ``p`` corrected for all that is
    tried, and the ``detectable`` amplitude, rad: of a sine, of the whole change over the span, of a step, and half the
    change over the range of a temperature; ``between`` is chi-square between images over its ``freedom``."""

    name: str
    columns: tuple[str, ...]
    p: float
    detectable: float
    between: float
    freedom: int


def directed_tests(
    sums: ImageSums, when: When, scales: Scales, families: Mapping[str, tuple[tuple[str, ...], ...]]
) -> tuple[DirectedTest, ...]:
    """The tests of all ``families`` of columns, the most likely motion first."""
    weights = _weights(families)
    found = [_tested(sums, when, scales, name, sets, weights[name]) for name, sets in families.items()]
    return tuple(sorted(found, key=lambda test: test.p))


def _weights(families: Mapping[str, tuple[tuple[str, ...], ...]]) -> dict[str, float]:
    """Share of the probability of a false alarm that each test may use: the same for every kind of motion, half of it
    for the first harmonic, equal for the alternatives of a kind."""
    kinds: dict[str, list[str]] = {}
    for name in families:
        kinds.setdefault(name.partition(":")[0], []).append(name)
    share = {}
    for kind, names in kinds.items():
        own = [float(len(names) - 1 or 1) if kind == ORBIT and i == 0 else 1.0 for i in range(len(names))]
        for name, part in zip(names, own, strict=True):
            share[name] = part / sum(own) / len(kinds) / len(families[name])
    return share


def _tested(
    sums: ImageSums, when: When, scales: Scales, name: str, sets: tuple[tuple[str, ...], ...], weight: float
) -> DirectedTest:
    from ...solve.probability import chdtrc, fdtrc

    F = np.stack([scales.columns((MEAN, *columns), when) for columns in sets])
    q = F.shape[-1] - 1
    M, v = sums.equations(F)
    M0, v0 = sums.equations(F[:1, :, :1])
    whole = _gained(M, v)
    T = np.maximum(whole - _gained(M0, v0), 0.0)
    own, determined = sums.own_rotations
    n = determined - 3 * (q + 1)
    S = np.maximum(own - whole, 0.0)
    p = np.maximum(chdtrc(3 * q, T), fdtrc(3 * q, n, (T / (3 * q)) / np.maximum(S / n, 1e-12)))
    best = int(np.argmin(p))
    # the amplitude is that of a step in the middle of the images, where it is found best
    shown = len(sets) // 2
    larger = float(S[best] / n) if chdtrc(n, S[best]) < LARGER_P else 1.0
    amplitude = detectable(_schur(M[shown]), q, n, FOUND_P * weight, sine=name.startswith(ORBIT))
    return DirectedTest(
        name,
        sets[best],
        min(float(p[best]) / weight, 1.0),
        float(amplitude * np.sqrt(larger)),
        float(S[best] / n),
        n,
    )


def _gained(M: Array, v: Array) -> Array:
    """``v^T M^-1 v`` (...)."""
    return np.asarray(np.sum(v * np.linalg.solve(M, v[..., None])[..., 0], axis=-1))


def _schur(M: Array) -> Array:
    """Information on all but the first three unknowns, those being free."""
    return np.asarray(M[3:, 3:] - M[3:, :3] @ np.linalg.solve(M[:3, :3], M[:3, 3:]))


def detectable(information: Array, q: int, n: int, level: float, *, sine: bool) -> float:
    """Amplitude that a test of 3 q numbers (``information`` (3 q, 3 q)) at a level finds with :data:`POWER`."""
    from ...solve.probability import chdtri, fdtri, ncfdtr

    patterns = _patterns(q, sine)
    unit = np.einsum("pi,ij,pj->p", patterns, information, patterns)
    if not np.all(unit > 0.0):
        return float("inf")
    limit = float(fdtri(3 * q, n, 1.0 - level))
    # both must speak: F with the residuals' own scale, and chi-square
    shift = np.geomspace(0.5, 1e4, 60)
    power = 1.0 - ncfdtr(3 * q, n, shift, limit)
    power = np.where(np.isfinite(power), power, 1.0)
    power = np.minimum(power, _chi2_power(3 * q, shift, float(chdtri(3 * q, level))))
    sizes = np.sqrt(np.geomspace(1.0, 1e4, 200) / np.median(unit))
    mean = np.mean(np.interp(sizes[:, None] ** 2 * unit, shift, power, left=0.0), axis=-1)
    return float(np.interp(POWER, np.maximum.accumulate(mean), sizes, left=np.inf, right=np.inf))


def _chi2_power(k: int, shift: Array, limit: float) -> Array:
    from ...solve.probability import chndtr

    return np.asarray(1.0 - chndtr(limit, k, shift))


def _patterns(q: int, sine: bool) -> Array:
    """Motions of amplitude 1 about each axis, (p, 3 q): of the last harmonic at phases spread evenly, or of one
    column with all signs."""
    index = np.arange(SHIFTS**2)
    if not sine:
        signs = 1.0 - 2.0 * ((np.arange(4)[:, None] >> np.arange(3)) & 1)
        return np.asarray(np.concatenate([np.zeros((4, 3 * (q - 1))), signs], axis=-1))
    # a lattice of phases: the first axis's, and those of the others after it
    phases = (
        2.0
        * np.pi
        * np.stack([index / index.size, (5 * index % 64) / 64.0, (27 * index % 64) / 64.0], axis=-1)
    )
    pairs = np.concatenate([np.cos(phases), np.sin(phases)], axis=-1)
    return np.asarray(np.concatenate([np.zeros((index.size, 3 * (q - 2))), pairs], axis=-1))


def headline(tests: tuple[DirectedTest, ...]) -> float | None:
    """The detectable amplitude to lead with, rad: of a sine with the orbit, else of a drift over the span, else of a
    step; None where nothing is tested."""
    by_name = {test.name: test.detectable for test in tests}
    names = (f"{ORBIT}:1", LINEAR, STEP, *by_name)
    return next((by_name[name] for name in names if name in by_name), None)
