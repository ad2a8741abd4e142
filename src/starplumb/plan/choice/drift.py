"""Which motion of the mounting the chosen images would find, by the tests that a calibration makes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...judge.motion.directed import directed_tests, headline
from ...judge.motion.found import FEWEST
from ...judge.motion.regressors import Scales, When, families
from ...judge.motion.sums import ImageSums
from ...table.phases import OrbitPhase
from .pick import Design

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def detectable(design: Design, picks: list[int], when: When, orbit: OrbitPhase | None) -> float | None:
    """Amplitude, rad, of a motion that tests of these images (``when`` (m,)) find with 90 % probability: of a sine with
    the orbit, else of a steady change over the span; None for too few images."""
    if len(picks) < FEWEST:
        return None
    sums = _sums(design, picks)
    scales = Scales.of(when, orbit)
    tests = directed_tests(sums, when, scales, families(when, scales))
    size = headline(tests)
    return size if size is not None and np.isfinite(size) else None


def _sums(design: Design, picks: list[int]) -> ImageSums:
    """What each image says of a rotation of its own, and what it shares with the others."""
    i = design.information.only(np.array(picks))
    m, g = i.n, i.common - 3
    N = i.factor @ i.factor.mT
    passes = np.unique(i.pass_of, return_inverse=True)[1]
    sites = np.unique(i.site_of, return_inverse=True)[1]
    first = g + i.of_pass * (int(passes.max()) + 1)
    width = first + i.of_site * (int(sites.max()) + 1)
    B, C = np.zeros((m, 3, width)), np.eye(width)
    for k in range(m):
        at = np.concatenate(
            [
                np.arange(g),
                g + i.of_pass * passes[k] + np.arange(i.of_pass),
                first + i.of_site * sites[k] + np.arange(i.of_site),
            ]
        )
        B[k][:, at] = N[k, :3, 3:]
        C[np.ix_(at, at)] += N[k, 3:, 3:]
    W = np.linalg.solve(np.linalg.cholesky(C), B.mT) if width else np.zeros((m, 0, 3))
    nothing = np.zeros(width)
    prior = np.asarray(np.linalg.inv(design.P_theta), dtype=np.float64)
    return ImageSums(np.arange(m), N[:, :3, :3], np.zeros((m, 3)), W, nothing, prior, np.zeros(3))
