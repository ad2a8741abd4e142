"""Least squares where its own tests let it stand, else the robust answer: what ``calibrate`` uses by default."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..solve.reliability import excess, variance_factor
from ..table.observations import Observations
from .fit import Fit, State
from .gls import Gls
from .protocol import AlignmentEstimate, Status, Verdict, stack
from .robust import Robust
from .spread import further_spread
from .usable import EXACT

Array = NDArray[np.float64]

LARGER = 4.0
"""Variance of sightings, over the stated one, up to which the noise of all is believed to be larger than stated: many
small blunders look like it too."""
TESTS = 4
"""Kinds of tests that may object: of sightings, of images, of landmarks, and chi-square."""


@dataclass(frozen=True)
class Default:
    """:class:`Gls`; where one of its tests objects, the answer of the sightings that do not contradict one another.

    Tested are each sighting, each image and each landmark seen again (:mod:`starplumb.solve.reliability`), and
    chi-square; all together object to a good campaign with the probability ``alpha`` at most (Bonferroni).  Then
    :class:`Robust` has the answer, with two limits to what it may leave out:

    * an image only if it is wrong by itself: where a larger variance, a drift or sessions explain the images as well
      (:mod:`starplumb.estimators.spread`), sightings are tested again with that spread allowed for, and none leaves for
      it;
    * a sighting only if one of those left out is wrong beyond the same level, or the others then fit as stated, or
      with half of the variance; otherwise nothing is.

    Where :class:`Robust` finds no answer, that of :class:`Gls` stands for judgement.
    """

    gls: Gls = field(default_factory=Gls)
    alpha: float = 5e-4

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        batch = np.broadcast_shapes(observations.batch, C_EK.shape[:-2])
        if not batch:
            return self._run(observations, C_EK)
        models = np.broadcast_to(C_EK, (*batch, 3, 3))
        runs = [self._run(observations.run(index), models[index]) for index in np.ndindex(*batch)]
        return stack(runs, batch)

    def _run(self, o: Observations, C_EK_model: Array) -> AlignmentEstimate:
        plain = replace(self.gls(o, C_EK_model), verdict=np.zeros(o.n, dtype=np.int64))
        if not self._objects(self._fit(o, C_EK_model, plain), plain):
            return plain
        found = self._within_spread(o, C_EK_model, Robust(self.gls)(o, C_EK_model))
        answered = Status(int(found.status)) in (Status.OK, Status.REFUTED)
        if not Status(int(plain.status)).usable:
            return found
        return (
            found if answered and (self._calmer(plain, found) or self._sure(o, C_EK_model, found)) else plain
        )

    def _fit(self, o: Observations, C_EK_model: Array, estimate: AlignmentEstimate) -> Fit:
        """The adjustment at an estimate, of the sightings it uses."""
        values = np.zeros(0) if estimate.parameters is None else estimate.parameters.values
        weight = np.where(estimate.verdict == int(Verdict.USED), o.weight, 0.0)
        return Fit(self.gls.unknowns, replace(o, weight=weight), State(estimate.C_EK, values), C_EK_model)

    def _objects(self, fit: Fit, plain: AlignmentEstimate) -> bool:
        """Whether a test of the least squares finds its answer improbable."""
        if not Status(int(plain.status)).usable:
            return int(plain.status) == int(Status.NOT_CONVERGED)
        seen, tested, factor = fit.table.weight > 0.0, fit.tested(), 1.0
        if tested is not None:
            T, groups = excess(tested, seen, *self._levels(fit.table))
            if max(float(np.max(over, initial=0.0)) for over in (T[seen], *groups)) > 1.0:
                return True
            factor = min(LARGER, variance_factor(tested.sightings[0][seen]))
        return self._beyond(plain, factor)

    def _beyond(self, plain: AlignmentEstimate, factor: float) -> bool:
        """Whether chi-square is improbable, and more so than noise that is larger than stated by a factor."""
        from ..solve.probability import chdtrc

        variance, dof = _variance(plain) / factor, int(np.asarray(plain.degrees_of_freedom))
        return dof > 0 and variance > EXACT**2 and float(chdtrc(dof, variance * dof)) < self.alpha / TESTS

    def _levels(self, o: Observations) -> tuple[float, float]:
        """Levels of the test of a sighting, and of an image or landmark, that keep the level of all together."""
        level = self.alpha / TESTS
        return level / max(o.n, 1), level / max(o.n_images, o.n_landmarks, 1)

    def _within_spread(
        self, o: Observations, C_EK_model: Array, found: AlignmentEstimate
    ) -> AlignmentEstimate:
        """The robust answer, with the images back whose difference a spread of all explains as well."""
        if Status(int(found.status)) not in (Status.OK, Status.REFUTED):
            return found
        extra_E = further_spread(self._fit(o, C_EK_model, found), o.weight > 0.0)
        if extra_E is None:
            return found
        tolerant = Robust(self.gls)(replace(o, cov_attitude_E=o.cov_attitude_E + extra_E), C_EK_model)
        fit = self._fit(o, C_EK_model, tolerant)
        if Status(int(tolerant.status)) not in (Status.OK, Status.REFUTED):
            return tolerant
        stated = self.gls.estimate(fit.table, C_EK_model, fit.state)
        return replace(stated, verdict=tolerant.verdict, notes=tolerant.notes, rival=tolerant.rival)

    def _calmer(self, plain: AlignmentEstimate, found: AlignmentEstimate) -> bool:
        """Whether what is kept fits as stated, or with half of the variance: noise alone leaves no such rest."""
        if not self._beyond(found, 1.0):
            return self._beyond(plain, 1.0)
        return _variance(found) < 0.5 * _variance(plain)

    def _sure(self, o: Observations, C_EK_model: Array, found: AlignmentEstimate) -> bool:
        """Whether something is left out that is wrong beyond the level of all tests together."""
        assert found.verdict is not None
        out = (found.verdict != int(Verdict.USED)) & (o.weight > 0.0)
        if np.any(found.verdict[out] != int(Verdict.SIGHTING)):
            return True
        tested = self._fit(o, C_EK_model, found).tested() if np.any(out) else None
        return tested is not None and bool(
            np.any(excess(tested, o.weight > 0.0, *self._levels(o))[0][out] > 1.0)
        )


def _variance(estimate: AlignmentEstimate) -> float:
    """Chi-square of an estimate by least squares over its degrees of freedom, infinite where there are none."""
    dof = int(np.asarray(estimate.degrees_of_freedom))
    return float(np.asarray(estimate.chi2)) / dof if dof > 0 else np.inf
