"""A budget as a document and in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..estimators.fit import Fit, State
from ..estimators.protocol import Estimator
from ..judge.motion.found import moves, would_be_found
from ..physics.units import ARCSEC, DEG
from ..plan.scenario import Scenario
from .budget import Budget, Direction, Requirement, Share, budget, directions, requirements
from .provenance import made_with

Array = NDArray[np.float64]

SCHEMA = "starplumb-budget/1"
WEAK = 3.0
"""A direction known this many times worse than the best one is called badly determined."""
WRONG = 0.02
"""Stated and true sigma that differ by more than this part are called different."""
NAMED = 0.1
"""A source is named in a sentence from this part of the variance on."""
AXES = ("x", "y", "z")


def document(scenario: Scenario, methods: Mapping[str, Estimator], target: float | None) -> dict[str, Any]:
    """Budgets of the methods as a document; with a ``target`` (rad) also what each source must shrink to."""
    found = {name: budget(scenario, estimator) for name, estimator in methods.items()}
    return {
        "schema": SCHEMA,
        "fingerprint": made_with(scenario, methods),
        "scenario": scenario.name,
        "description": scenario.description,
        "images": scenario.truth.n_images,
        "sightings": scenario.truth.n,
        "stated_model_is_true": scenario.model_is_true,
        "methods": {name: _method(scenario, one) for name, one in found.items()},
        "motion": _motion(scenario),
        "left_out": [source.name for source in scenario.sources if source.is_blunder],
        "target": None if target is None else _target(scenario, target, next(iter(found.values()))),
    }


def _motion(scenario: Scenario) -> dict[str, Any] | None:
    """The amplitudes of a moving mounting that tests of the images find with 90 % probability; null for too few."""
    C_EK, unknowns = scenario.C_EK_true, scenario.unknowns
    fit = Fit(unknowns, scenario.stated, State(C_EK, np.zeros(len(unknowns.names))), C_EK)
    found = moves(scenario.campaign, fit)
    if found is None or found.detectable is None:
        return None
    tests = {test.name: _finite(test.detectable / ARCSEC) for test in found.tests}
    return {
        "detectable_arcsec": _finite(found.detectable / ARCSEC),
        "tests": tests,
        "in_words": would_be_found(found),
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _arcsec(values: Array) -> list[float]:
    return [float(value / ARCSEC) for value in values]


def _method(scenario: Scenario, found: Budget) -> dict[str, Any]:
    stated = None if found.stated_E is None else np.sqrt(np.diagonal(found.stated_E))
    return {
        "sigma_arcsec": _arcsec(found.sigma_E),
        "covariance_arcsec2": [_arcsec(row / ARCSEC) for row in found.true_E],
        "stated_sigma_arcsec": None if stated is None else _arcsec(stated),
        "sources": [_share(share, found) for share in found.shares],
        "directions": [_direction(scenario, one) for one in directions(found.true_E)],
        "in_words": list(words(scenario, found)),
    }


def _share(share: Share, found: Budget) -> dict[str, Any]:
    unit = share.source.unit
    own = np.sqrt(np.diagonal(share.covariance_E))
    return {
        "source": share.source.name,
        "component": share.source.labels[share.component],
        "words": share.source.words,
        f"sigma_{unit.name}": share.sigma / unit.size,
        "contribution_arcsec": _arcsec(own),
        "part_of_variance": [float(part) for part in (own / found.sigma_E) ** 2],
        f"sensitivity_alone_arcsec_per_{unit.name}": _arcsec(share.response_E * unit.size),
        f"sensitivity_arcsec_per_{unit.name}": _arcsec(share.derivative_E * unit.size),
    }


def _direction(scenario: Scenario, direction: Direction) -> dict[str, Any]:
    return {
        "sigma_arcsec": direction.sigma / ARCSEC,
        "axis_tracker": [float(value) for value in direction.axis_E],
        "axis_camera": [float(value) for value in scenario.C_EK_true.mT @ direction.axis_E],
        "in_words": about(scenario.C_EK_true.mT @ direction.axis_E),
    }


def about(axis_K: Array) -> str:
    """A rotation axis in the camera's terms."""
    names = ("the columns (x)", "the rows (y)", "the boresight (z)")
    nearest = int(np.argmax(np.abs(axis_K)))
    angle = float(np.arccos(min(abs(axis_K[nearest]), 1.0))) / DEG
    if angle < 20.0:
        return f"a turn about {('the column axis x', 'the row axis y', 'the boresight z')[nearest]} of the camera"
    listed = " and ".join(names[i] for i in range(3) if abs(axis_K[i]) > 0.3)
    return f"a turn about an axis between {listed} of the camera"


def words(scenario: Scenario, found: Budget) -> Iterator[str]:
    """Sentences: what is badly determined and by what, and whether the stated sigma is the true one."""
    best, _, worst = directions(found.true_E)
    ratio = worst.sigma / best.sigma if best.sigma > 0.0 else np.inf
    causes = _causes(found, worst.axis_E)
    how = about(scenario.C_EK_true.mT @ worst.axis_E)
    if ratio > WEAK:
        yield (
            f"badly determined: {how}, {worst.sigma / ARCSEC:.3g} arcsec, {ratio:.2g} times as much as "
            f"{about(scenario.C_EK_true.mT @ best.axis_E)}; {causes}"
        )
    else:
        yield f"no direction is badly determined; the weakest is {how}, {worst.sigma / ARCSEC:.3g} arcsec; {causes}"
    if found.stated_E is None:
        yield "the method states no covariance"
        return
    true, stated = found.sigma_E, np.sqrt(np.diagonal(found.stated_E))
    off = {axis: t / s for axis, t, s in zip(AXES, true, stated, strict=True) if abs(t / s - 1.0) > WRONG}
    if off:
        listed = ", ".join(f"{value:.3g} times the stated one about {axis}" for axis, value in off.items())
        yield f"the true sigma is {listed}: the stated model is wrong"
    else:
        yield "the stated sigma is the true one"


def _causes(found: Budget, axis_E: Array) -> str:
    """The sources that make up the variance of a direction, largest first."""
    total = float(axis_E @ found.true_E @ axis_E)
    parts: dict[str, float] = {}
    for share in found.shares:
        part = float(axis_E @ share.covariance_E @ axis_E) / total
        parts[share.source.name] = parts.get(share.source.name, 0.0) + part
    ranked = sorted(parts.items(), key=lambda item: -item[1])
    named = [f"{100.0 * part:.0f} % of its variance is {name}" for name, part in ranked if part >= NAMED]
    return ", ".join(named)


def _target(scenario: Scenario, target: float, found: Budget) -> dict[str, Any]:
    asked = requirements(scenario, target)
    together = min(1.0, float(target / np.max(found.sigma_E)))
    return {
        "target_arcsec": target / ARCSEC,
        "sources": [_requirement(one) for one in asked],
        "factor_all_sources": together,
        "in_words": [*(_ask(one, target) for one in asked), f"all sources together: {together:.3g} of each"],
    }


def _factors(one: Requirement) -> list[float | None]:
    return [None if np.isnan(factor) else float(factor) for factor in one.factor]


def _requirement(one: Requirement) -> dict[str, Any]:
    unit, factors = one.source.unit, _factors(one)
    every = None if None in factors else min(factor for factor in factors if factor is not None)
    return {
        "source": one.source.name,
        "factor": factors,
        "factor_all_axes": every,
        f"sigma_{unit.name}": _scaled(one, 1.0),
        f"wanted_sigma_{unit.name}": None if every is None else _scaled(one, every),
        "without_it_arcsec": _arcsec(one.without_E),
    }


def _scaled(one: Requirement, factor: float) -> list[float]:
    return [float(factor * sigma / one.source.unit.size) for sigma in one.source.sigma]


def _ask(one: Requirement, target: float) -> str:
    """What is asked of one source, the others as they are."""
    factors, unit = _factors(one), one.source.unit.name
    never = [axis for axis, factor in zip(AXES, factors, strict=True) if factor is None]
    if never:
        left = ", ".join(
            f"{one.without_E[AXES.index(axis)] / ARCSEC:.3g} arcsec about {axis}" for axis in never
        )
        return f"{one.source.name}: not enough alone; without it there would still be {left}"
    factor = min(factor for factor in factors if factor is not None)
    if factor == 1.0:
        return f"{one.source.name}: {target / ARCSEC:g} arcsec is reached as it is"
    now, then = (", ".join(f"{value:.3g}" for value in dict.fromkeys(_scaled(one, f))) for f in (1.0, factor))
    return f"{one.source.name}: from {now} to {then} {unit} ({factor:.3g} of it), the others as they are"
