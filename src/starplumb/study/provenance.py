"""What the numbers of a study or a budget depend on."""

from __future__ import annotations

from collections.abc import Mapping

from .. import __version__
from ..estimators.protocol import Estimator
from ..plan.scenario import Scenario


def made_with(scenario: Scenario, methods: Mapping[str, Estimator]) -> dict[str, str]:
    """The version, the scenario with the digest of its document, and the methods with their options."""
    return {
        "starplumb": __version__,
        "scenario": f"{scenario.name}, sha256:{scenario.digest}",
        "methods": ", ".join(f"{name}: {estimator!r}" for name, estimator in methods.items()),
    }
