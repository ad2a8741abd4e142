"""Generalised least squares that survives wrong labels, wrong measurements and wrong images."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..solve.reliability import NOISE, Tested, excess
from ..table.observations import Observations
from .agreement import MEMBERS, agreed, clusters_of, contradicting, large
from .consensus import Consensus, Directions, consensus
from .fit import Fit, State, Unknowns
from .gls import Gls
from .protocol import NO_RIVAL, AlignmentEstimate, Rival, Status, Verdict, stack

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LIKELY = 0.03
"""Share of its plausible range within which a free parameter is expected while nothing is estimated yet."""
LEAST = 4
"""Sightings of an image that must agree before it is called wrong: two fix a rotation, two more confirm it."""
AT_ONCE = 1e-3
"""Share of all images, or landmarks, that may leave together, the worst one in any case."""
PASSES = 60
EVEN = 0.8
"""Support of a rival answer, over that of the answer, from which on nothing says which of the two is right."""


@dataclass(frozen=True)
class Robust:
    """Consensus on the rotation, then least squares with data snooping; the answer is that of the sightings kept.

    1. :func:`consensus <starplumb.estimators.consensus.consensus>`: the rotation most sightings agree on to within the
       stated errors, shared ones included.  Finds the mounting whatever the initial error.
    2. In each image a cluster of residuals that differ by no more than what its sightings do not share: the attitude
       error of an image moves all of its residuals alike and is many pixels, the difference of two is not.  Of several,
       the one on which the images agree (:mod:`starplumb.estimators.agreement`).
    3. Data snooping (:mod:`starplumb.solve.reliability`): the worst sighting of each image, the worst image or the
       worst landmark leaves while its statistic exceeds the critical value, and whatever fits comes back.
    4. An image, or a landmark, that is out though its own sightings agree with one another is wrong as a whole.

    A good sighting is rejected with probability ``alpha`` (1e-3 is Baarda's choice), a good image or landmark with
    ``alpha_group``; on clean data that costs 0.2 % of the information.  Where hardly more sightings agree than would by
    chance the estimate is ``NOT_CONVERGED``; where the rejected ones agree on another answer, and are nearly as many as
    those kept, it is ``REFUTED``.
    """

    gls: Gls = field(default_factory=Gls)
    alpha: float = 1e-3
    alpha_group: float = 1e-4
    seed: int = 0

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        batch = np.broadcast_shapes(observations.batch, C_EK.shape[:-2])
        models = np.broadcast_to(C_EK, (*batch, 3, 3))
        runs = []
        for index in np.ndindex(*batch):
            one = observations.run(index) if observations.batch else observations
            runs.append(self._run(one, models[index]))
        return stack(runs, batch)

    def _run(self, o: Observations, C_EK_model: Array) -> AlignmentEstimate:
        search = _Search(self, o, C_EK_model)
        found = consensus(o, np.random.default_rng(self.seed), search.slack(C_EK_model))
        return search.failed() if found is None or not found.convincing else search.refine(found)


@dataclass(frozen=True)
class _Search:
    """One run: the options, the table without batch axes and the model mounting."""

    options: Robust
    o: Observations
    C_EK_model: Array

    @property
    def unknowns(self) -> Unknowns:
        return self.options.gls.unknowns

    @property
    def seen(self) -> Mask:
        return np.asarray(self.o.weight > 0.0)

    def _all(self, used: Mask) -> bool:
        """Whether all sightings are used."""
        return bool(np.array_equal(used, self.seen))

    def failed(self) -> AlignmentEstimate:
        """No alignment on which enough sightings agree: the plain estimate, marked as not to be used."""
        plain = self.options.gls(self.o, self.C_EK_model)
        usable = plain.status < int(Status.SINGULAR)
        status = np.where(usable, int(Status.NOT_CONVERGED), plain.status)
        return self.described(plain, status, np.zeros(self.o.n, dtype=np.int64))

    def described(
        self, estimate: AlignmentEstimate, status: NDArray[np.int64], verdict: NDArray[np.int64]
    ) -> AlignmentEstimate:
        """An estimate by gls as that of this method."""
        left_out = int(np.sum(verdict != int(Verdict.USED)))
        note = f"gls without the sightings that the others contradict: {left_out} left out"
        return replace(estimate, status=status, verdict=verdict, notes=(note,), rival=NO_RIVAL)

    def at(self, state: State, used: Mask) -> Fit:
        """The adjustment of the sightings used at a state."""
        weighted = replace(self.o, weight=np.where(used, self.o.weight, 0.0))
        return Fit(self.unknowns, weighted, state, self.C_EK_model)

    def moved(self, state: State, used: Mask, steps: int) -> State:
        """After a few Gauss-Newton steps with the sightings used."""
        for _ in range(steps):
            state = state.moved(self.at(state, used).step())
        return state

    def expected(self) -> Array:
        """Standard deviations (p + c,) of the further parameters before anything is estimated, and of the common
        errors."""
        known = self.unknowns.sigma
        sigma = np.where(np.isfinite(known), known, LIKELY * self.unknowns.range)
        common = 0 if self.o.common_px is None else self.o.common_px.shape[-1]
        return np.concatenate([sigma, np.ones(common)])

    def slack(self, C_EK: Array) -> Array | float:
        """Angle (n,) by which the further parameters and the common errors may move a sighting.

        They may move the two of a pair to opposite sides: root 2 times as far as errors of their own would.
        """
        expected = self.expected()
        if expected.size == 0:
            return 0.0
        start = State(C_EK, np.zeros(len(self.unknowns.names)))
        angle, fit = np.empty(self.o.n), self.at(start, self.seen)
        for rows, (_, model, A) in fit.parts():
            moved = model.B @ (A[..., 3:] * expected)
            angle[rows] = np.sqrt(2.0 * np.sum(moved**2, axis=(-2, -1)))
        return angle

    def refine(self, found: Consensus) -> AlignmentEstimate:
        state = State(found.C_EK, np.zeros(len(self.unknowns.names)))
        for _ in range(2):
            state, used = self._agreed(state, found)
            state = self.moved(state, used, 2)
            nearer = self._nearer(state)
            found = (
                nearer if np.any(nearer.agree) else found
            )  # none are near where a wrong prior pulls too far
            if self._all(used):  # again it would be the same
                break
        used = self._widened(state, used, found.agree)
        verdict = np.where(used | ~self.seen, int(Verdict.USED), int(Verdict.SIGHTING))
        state, verdict = self._snoop(state, verdict)
        for i in self._wrong_images(self.seen & (verdict == int(Verdict.USED))):
            verdict[self.seen & (self.o.image == i)] = int(Verdict.IMAGE)
        for place in self._wrong_landmarks(state, verdict):
            verdict[(self.o.landmark == place) & (verdict != int(Verdict.IMAGE))] = int(Verdict.LANDMARK)
        return self._finish(state, verdict, found)

    def _agreed(self, state: State, found: Consensus) -> tuple[State, Mask]:
        """The state on which the images agree, and the sightings of the clusters that say so."""
        kept = np.zeros(self.o.n, dtype=bool)
        parts = self.at(state, self.seen).parts()
        clusters = large(clusters_of(parts, self.seen, self._uncertainty(found)))
        if clusters.size == 0:
            return state, found.agree
        answer = agreed(clusters)
        for k in answer.clusters:
            kept[clusters.rows[k]] = True
        return State(so3.exp(answer.d_E) @ state.C_EK, state.values), kept

    def _uncertainty(self, found: Consensus) -> Array:
        """Standard deviations (3 + p + c,) of a state by consensus; its errors may still bend an image's residuals."""
        d = Directions.of(self.o.select(found.agree), 0.0)
        centred = d.e_K - np.mean(d.e_K, axis=0)
        radius = np.sqrt(np.mean(np.sum(centred**2, axis=-1)))
        turn = 2.0 * float(np.mean(d.own)) / max(radius, float(np.mean(d.own)))
        return np.concatenate([np.full(3, np.hypot(turn, float(np.mean(d.shared)))), self.expected()])

    def _nearer(self, state: State) -> Consensus:
        """The sightings within the shared errors of a better state."""
        near = np.zeros(self.o.n, dtype=bool)
        for rows, (table, _, _) in self.at(state, self.seen).parts():
            d = Directions.of(table)
            misfit = np.linalg.norm(d.e_K @ state.C_EK.mT - d.e_E, axis=-1)
            near[rows] = misfit < 4.0 * np.hypot(d.own, np.sqrt(2.0) * d.shared)
        return Consensus(state.C_EK, near & self.seen, True)

    def _widened(self, state: State, used: Mask, agree: Mask) -> Mask:
        """Sightings with which snooping starts: where the noise is larger than stated, more than those of the clusters.

        The 30 % quantile of T (0.713 for chi-square with 2 degrees of freedom) among those that agree says how much
        larger, be up to 60 % of them wrong; of two sets that each hold together, snooping then ends with the larger.
        """
        if self._all(used) or not np.any(agree):
            return used
        tested = self.at(state, used).tested()
        if tested is None:
            return used
        T = tested.sightings[0]
        factor = max(1.0, float(np.quantile(T[agree], 0.3)) / 0.713)
        return np.asarray(used | (agree & (NOISE * factor > T)))

    def _wrong_images(self, used: Mask) -> list[int]:
        """Images of which hardly a sighting is used though most of them agree on an attitude of their own."""
        counts, kept = (
            np.bincount(self.o.image[mask], minlength=self.o.n_images) for mask in (self.seen, used)
        )
        wrong = []
        for i in np.flatnonzero((counts >= LEAST) & (kept < counts) & (kept <= 0.1 * counts)):
            rows = self.o.select(self.seen & (self.o.image == i))
            own = consensus(rows, np.random.default_rng(self.options.seed), self._bend(rows), alone=True)
            if own is not None and np.sum(own.agree) >= max(LEAST, 0.5 * counts[i]):
                wrong.append(int(i))
        return wrong

    def _wrong_landmarks(self, state: State, verdict: NDArray[np.int64]) -> list[int]:
        """Landmarks of which hardly a sighting is used though most of them agree on another place."""
        out = self.seen & (verdict == int(Verdict.SIGHTING))
        used = self.seen & (verdict == int(Verdict.USED))
        lost, kept = (
            np.bincount(self.o.landmark[mask], minlength=self.o.n_landmarks) for mask in (out, used)
        )
        wrong = []
        for place in np.flatnonzero((lost > 2) & (kept <= 0.25 * (lost + kept))):
            mine = (out | used) & (self.o.landmark == place)
            free = np.array(self.o.cov_landmark_J)
            free[place] += 1e8 * np.eye(3)
            fit = self.at(state, used | mine)
            tested = replace(fit, table=replace(fit.table, cov_landmark_J=free)).tested()
            if tested is None:
                continue
            fits = excess(tested, self.seen, self.options.alpha, self.options.alpha_group)[0][mine] <= 1.0
            if np.mean(fits) >= 0.75:
                wrong.append(int(place))
        return wrong

    def _bend(self, rows: Observations) -> Array:
        """Angle (n,) by which a wrong epoch bends an image beyond a rotation: field angle times shift, 2 deg of it."""
        centred = rows.e_K - np.mean(rows.e_K, axis=0)
        return np.asarray(0.002 * np.linalg.norm(centred, axis=-1))

    def _snoop(self, state: State, verdict: NDArray[np.int64]) -> tuple[State, NDArray[np.int64]]:
        """Drop what does not fit and take back what does, worst first, until nothing changes."""
        dropped = np.zeros(self.o.n, dtype=np.int64)
        for _ in range(PASSES):
            used = self.seen & (verdict == int(Verdict.USED))
            state = self.moved(state, used, 1)
            tested = self.at(state, used).tested()
            if tested is None:
                break
            changed = self._pass(tested, verdict, dropped)
            if changed is None:
                break
            verdict = changed
        return state, verdict

    def _pass(
        self, tested: Tested, verdict: NDArray[np.int64], dropped: NDArray[np.int64]
    ) -> NDArray[np.int64] | None:
        """The verdicts after one pass, None where none changes; ``dropped`` counts how often each went."""
        T, critical = excess(tested, self.seen, self.options.alpha, self.options.alpha_group)
        verdict = verdict.copy()
        free = self.seen & np.isin(verdict, (int(Verdict.USED), int(Verdict.SIGHTING)))
        used = self.seen & (verdict == int(Verdict.USED))
        worst = float(np.max(T[used], initial=0.0))
        groups = {Verdict.IMAGE: critical[0], Verdict.LANDMARK: critical[1]}
        kind = max(groups, key=lambda g: float(np.max(groups[g], initial=0.0)))
        largest = float(np.max(groups[kind], initial=0.0))
        if largest > max(1.0, worst):
            most = max(1, int(AT_ONCE * groups[kind].size))
            members = np.argsort(groups[kind])[: -most - 1 : -1]
            members = members[groups[kind][members] > max(1.0, worst, 0.5 * largest)]
            of = np.isin(self.o.image, members)
            if kind is Verdict.LANDMARK:
                of = np.isin(self.o.landmark, tested.repeated[members])
            verdict[free & of] = int(kind)
            return verdict
        out = used & (T > 1.0) & (_largest_of(T, used, self.o.image) <= T)
        back = free & ~used & (T <= 1.0) & (dropped < 2)
        dropped += out
        verdict[out], verdict[back] = int(Verdict.SIGHTING), int(Verdict.USED)
        return verdict if np.any(out | back) else None

    def _finish(self, state: State, verdict: NDArray[np.int64], found: Consensus) -> AlignmentEstimate:
        used = self.seen & (verdict == int(Verdict.USED))
        if not np.any(used):
            return self.failed()
        kept = replace(self.o, weight=np.where(used, self.o.weight, 0.0))
        estimate = self.options.gls.settled(kept, self.C_EK_model, state)
        other = self._rival(estimate, used, found)
        status = estimate.status
        if other.support >= EVEN and Status(int(status)).usable:
            status = np.asarray(int(Status.REFUTED))
        return replace(self.described(estimate, status, verdict), rival=other)

    def _rival(self, estimate: AlignmentEstimate, used: Mask, found: Consensus) -> Rival:
        """The answer that the rejected sightings support best."""
        left_out = self.o.image[self.seen & ~used]
        if np.max(np.bincount(left_out), initial=0) < 0.5 * MEMBERS:  # too few to be most of a cluster
            return NO_RIVAL
        values = np.zeros(0) if estimate.parameters is None else estimate.parameters.values
        parts = self.at(State(estimate.C_EK, values), self.seen).parts()
        against = contradicting(clusters_of(parts, self.seen, self._uncertainty(found)), used)
        if against.size == 0:
            return NO_RIVAL
        counts, kept = (np.bincount(self.o.image[m], minlength=self.o.n_images) for m in (self.seen, used))
        answer, own = agreed(against), np.sum(kept / np.maximum(counts, 1))
        return Rival(np.asarray(answer.votes / own), answer.d_E, np.asarray(answer.clusters.size))


def _largest_of(T: Array, used: Mask, group: NDArray[np.int64]) -> Array:
    """The largest T of the used members of each sighting's group, (n,)."""
    largest = np.zeros(group.max(initial=0) + 1)
    np.maximum.at(largest, group[used], T[used])
    return np.asarray(largest[group])
