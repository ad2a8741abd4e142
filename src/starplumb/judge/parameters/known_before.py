"""Do the data contradict what was known before them, of the mounting or of a parameter, and what do they say alone?

An estimate x (k,) about what was known, with the covariance C in which a prior P of some of the unknowns has a part,
differs from it by x with the covariance ``P - C``.  Without a prior the data alone say, with ``C = L L^T``::

    M = 1 - L^T P^-1 L,     x_alone = L M^-1 L^-1 x,     C_alone = L M^-1 L^T

where M is singular the data say nothing, and what was known stands.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...estimators.protocol import AlignmentEstimate, ParameterVector
from ...physics import so3
from ...physics.units import ARCSEC
from ...table.observations import Observations
from ...table.parameter_names import UNITS, unit_of
from ..trust import NORMAL_95, Finding, probability
from .separability import in_words, of_camera

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CONTRADICTED_P = 1e-4
"""Probability of a difference at least this large below which the data contradict what was known."""
NOTHING = 1e-6
"""Part of what is known that comes from the data, below which they say nothing."""


@dataclass(frozen=True)
class Known:
    """What was known of the unknowns ``at`` (q,): their covariance (q, q), and ``said``, where and how well."""

    at: Index
    covariance: Array
    said: str
    unit: tuple[str, float]

    @property
    def block(self) -> tuple[Index, Index]:
        """Where their part of a matrix stands."""
        return self.at[:, None], self.at

    def probability(self, x: Array, C: Array) -> float:
        """Of a difference at least as large as that of the estimate."""
        from ...solve.probability import chdtrc

        spread, axes = np.linalg.eigh(self.covariance - C[self.block])
        told = spread > NOTHING * np.trace(self.covariance)
        square = float(np.sum((axes.T @ x[self.at])[told] ** 2 / spread[told]))
        return float(chdtrc(int(np.sum(told)), square)) if np.any(told) else 1.0

    def sentence(self, x: Array, p: float) -> str:
        name, unit = self.unit
        size = f"{np.linalg.norm(x[self.at]) / unit:.3g} {name}".rstrip()
        return (
            f"the data contradict {self.said}: the correction is {size} ({probability(p)}), and what was known pulls "
            "it towards zero; the interval holds what the data say alone; state a larger sigma or leave it out"
        )


def contradicted(
    o: Observations, C_EK_model: Array, estimate: AlignmentEstimate, known_from: str
) -> list[Finding]:
    """What was known before an estimate (no batch axes) with a covariance and is contradicted by its data."""
    assert estimate.covariance_E is not None
    x, C = so3.log(estimate.C_EK @ C_EK_model.mT), estimate.covariance_E
    p = estimate.parameters
    if p is not None:
        x, C = np.concatenate([x, p.values]), p.covariance
    found = [(known, known.probability(x, C)) for known in _known(o, C_EK_model, estimate, known_from)]
    wrong = [(known, chance) for known, chance in found if chance < CONTRADICTED_P]
    if not wrong:
        return []
    half_E = _of_all(_alone(x, C, [known for known, _ in wrong]), C, p)
    return [Finding(known.sentence(x, chance), True, half_E=half_E) for known, chance in wrong]


def _of_all(half: Array, C: Array, p: ParameterVector | None) -> Array:
    """Half-widths (3,) of the first camera's interval, by as many sigmas as any camera's mounting must have: theirs are
    as wide."""
    at = [*range(3), *([] if p is None else [3 + i for i, name in enumerate(p.names) if of_camera(name)])]
    sigma = np.sqrt(np.diagonal(C))
    if len(at) == 3:
        return half[:3]
    return np.asarray(np.maximum(half[:3], np.max(half[at] / sigma[at]) * sigma[:3]))


def _known(
    o: Observations, C_EK_model: Array, estimate: AlignmentEstimate, known_from: str
) -> Iterator[Known]:
    p = estimate.parameters
    if o.prior_E is not None:
        sigma = ", ".join(f"{s:.3g}" for s in np.sqrt(np.diagonal(o.prior_E)) / ARCSEC)
        at, P = np.arange(3), o.prior_E
        if o.rig_known is not None and p is not None:
            further = [3 + i for i, name in enumerate(p.names) if of_camera(name)]
            at, P = np.array([0, 1, 2, *further]), o.rig_known.of_unknowns(C_EK_model)
        yield Known(at, P, f"{known_from} ({sigma} arcsec)", ("arcsec", ARCSEC))
    if p is None:
        return
    for k, (name, sigma_0) in enumerate(zip(p.names, p.prior_sigma.tolist(), strict=True), start=3):
        if np.isfinite(sigma_0):
            name_of_unit = unit_of(name)
            unit = UNITS[name_of_unit]
            stated = f"{sigma_0 / unit:.3g} {name_of_unit}".rstrip()
            yield Known(
                np.array([k]),
                np.array([[sigma_0**2]]),
                f"the {stated} stated of {in_words(name)}",
                (name_of_unit, unit),
            )


def _alone(x: Array, C: Array, wrong: list[Known]) -> Array:
    """Half-widths (k,) about the estimate of intervals that hold what the data say without what is contradicted."""
    information = np.zeros_like(C)
    for known in wrong:
        information[known.block] = np.linalg.inv(known.covariance)
    scale = np.sqrt(np.diagonal(C))
    L = scale[:, None] * np.linalg.cholesky(C / scale / scale[:, None])
    share, axes = np.linalg.eigh(np.eye(len(C)) - L.T @ information @ L)
    part = np.where(share > NOTHING, share, 1.0)
    y = axes.T @ np.linalg.solve(L, x)
    back = L @ axes
    return np.asarray(np.abs(back @ (y / part - y)) + NORMAL_95 * np.sqrt(np.sum(back**2 / part, axis=-1)))
