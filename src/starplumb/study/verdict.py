"""What a study found, in sentences: whether the stated sigmas are true, the tails heavy, and the bound reached."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

TOLERANCE = 0.02
"""A figure that is off by less than this part of itself is not called wrong: estimators are linearised."""
HEAVY = 4.0
"""Kurtosis from which the tails are called heavy (3 for a Gaussian)."""


def verdict(trials: int, document: dict[str, Any]) -> Iterator[str]:
    """Sentences about what one estimator did; the first ones say what is wrong."""
    if document["failed"]:
        kinds = ", ".join(
            f"{count} {key.replace('_', ' ')}" for key, count in document["status"].items() if count
        )
        yield (
            f"{'all' if document['failed'] == trials else document['failed']} of {trials} runs failed ({kinds}); "
            "their errors are in every figure"
            + (
                f", except {document['without_estimate']} without any estimate"
                if document["without_estimate"]
                else ""
            )
        )
    yield from _judge_stated(document)
    yield from _judge_tails(document, trials)
    yield from _judge_efficiency(document)


def _judge_stated(document: dict[str, Any]) -> Iterator[str]:
    if document["nees"] is None:
        yield "states no covariance, so its user cannot know how good it is"
        return
    about = {axis: found["error_over_stated"] for axis, found in document["axes"].items()}
    wrong = {axis: ratio for axis, ratio in about.items() if ratio["wrong"]}
    fit = document["chi2_per_degree_of_freedom"]
    if wrong:
        ratios = ", ".join(
            f"{r['value']:.3g} times its stated sigma about {axis}" for axis, r in wrong.items()
        )
        yield (
            f"the stated model is wrong: the error is {ratios} (1 wanted): an error is left out, "
            "or stated too large, or shared by more than is stated"
        )
    if fit is not None and fit["wrong"]:
        large = fit["value"] > 1.0
        yield (
            f"the residuals say so too: chi-square per degree of freedom is {fit['value']:.3g}, "
            + ("more than the stated errors allow" if large else "less than the stated errors lead to expect")
        )
    elif wrong:
        yield "the residuals do not show it (chi-square as stated): no fit to such data can find this out by itself"
    if not wrong and not document["nees"]["wrong"]:
        nees, listed = document["nees"], ", ".join(f"{ratio['value']:.3f}" for ratio in about.values())
        yield (
            f"the stated covariance is right: error over stated sigma {listed} about x, y, z; NEES {nees['value']:.3f} "
            f"(95 % band {nees['band_low']:.3f} to {nees['band_high']:.3f})"
        )
    elif not wrong:
        yield f"the stated correlations are wrong: NEES {document['nees']['value']:.3g} (1 wanted), each axis as stated"


def _judge_tails(document: dict[str, Any], trials: int) -> Iterator[str]:
    heavy = {axis: d["kurtosis"] for axis, d in document["axes"].items() if d["kurtosis"] > HEAVY}
    if heavy:
        listed = ", ".join(f"{value:.3g} about {axis}" for axis, value in heavy.items())
        yield (
            f"the errors have heavy tails (kurtosis {listed}; 3 for a Gaussian): the rule n = t^2 / (2 eps^2) promises "
            f"too much; sigma to 1 % at 3 standard errors takes {document['trials_for_1_percent']} trials, "
            f"{trials} were made"
        )


def _judge_efficiency(document: dict[str, Any]) -> Iterator[str]:
    ratios = {axis: d["rmse_over_bound"] for axis, d in document["axes"].items()}
    if any(ratio is None for ratio in ratios.values()):
        return
    worst = max(ratios, key=lambda axis: float(ratios[axis]["value"]))
    if ratios[worst]["low"] > 1.0 + TOLERANCE:
        listed = ", ".join(f"{ratio['value']:.3g} about {axis}" for axis, ratio in ratios.items())
        yield f"the Cramer-Rao bound is not reached: RMSE over bound {listed}"
