"""Every estimator on every problem in every batch shape: what a row of the harness needs to be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Estimator
from starplumb.estimators.published.cross_product import CrossProduct
from starplumb.estimators.published.ground_plane import GroundPlane
from starplumb.estimators.published.image_plane import ImagePlane
from starplumb.estimators.published.least_squares import LeastSquares
from starplumb.estimators.published.projective import Projective
from starplumb.estimators.sequential import Sequential
from starplumb.estimators.wahba import Wahba
from starplumb.table.geometry import observe
from starplumb.table.observations import Observations
from starplumb.table.simulate import Errors, measure

ONE_STEP: dict[str, type] = {
    "image-plane": ImagePlane,
    "ground-plane": GroundPlane,
    "cross-product": CrossProduct,
    "least-squares": LeastSquares,
}
CONVERGED: dict[str, Callable[[], Estimator]] = {
    **{name: (lambda kind=kind: kind(iterations=4)) for name, kind in ONE_STEP.items()},
    "image-plane narrow": lambda: ImagePlane(iterations=8, field="narrow"),
    "projective": lambda: Projective(iterations=3),
    "sequential": lambda: Sequential(passes=3),
    "gls": Gls,
    "wahba": Wahba,
}
"""Estimators with enough iterations that nothing but the data's errors is left."""
STATES_SIGMA = [name for name in CONVERGED if name != "wahba"]

PROBLEMS = {
    "frame": lambda: truth(FRAME, images=3, markers=6),
    "frame turned": lambda: truth(FRAME, images=3, markers=6, tilt_deg=25.0, yaw_deg=70.0),
    "frame one site": lambda: truth(FRAME, images=3, markers=4, shared_site=True),
    "line": lambda: truth(LINE, images=2, markers=6),
}
BATCHES = [(), (3,), (2, 3)]


@cache
def scene(problem: str) -> Observations:
    """The true table of a problem."""
    return observe(PROBLEMS[problem]())


def still(o: Observations) -> Observations:
    """The table measured without any error, but with its stated ones."""
    return measure(o, C_EK_TRUE, no_errors(o))


def no_errors(o: Observations) -> Errors:
    return Errors.draw(o, np.random.default_rng(0)).only("nothing")


@dataclass(frozen=True)
class Source:
    """One source of errors: its name in Errors and the field that states it."""

    name: str
    field: str

    def alone(self, o: Observations) -> Observations:
        """The table with every other source stated as zero."""
        others = {s.field: np.zeros_like(getattr(o, s.field)) for s in SOURCES if s is not self}
        if "sigma_px" in others:
            others["sigma_px"] = 1e-3 * o.sigma_px  # none at all would be no weights
        return replace(o, **others)


SOURCES = [
    Source("alpha_E", "cov_attitude_E"),
    Source("rho_J", "cov_position_J"),
    Source("pi_J", "cov_landmark_J"),
    Source("pixel", "sigma_px"),
]
