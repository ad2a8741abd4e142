"""The choice of images for a scenario: its views, what they tell, the best of them, and how far from the best."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...io.scenario.all_cameras import of_all_cameras
from ...io.scenario.candidates import Stage, agility, candidate_information, chosen_scenario, height_of
from ...io.scenario.tied import tied_scenario
from ...judge.motion.regressors import When
from ...physics.errors import InputError
from ...physics.units import ARCSEC, DEG
from ...plan.bound import bound_E
from ...plan.choice.certificate import Certificate, Room, certificate
from ...plan.choice.drift import detectable
from ...plan.choice.ground import ground_weight
from ...plan.choice.information import Information
from ...plan.choice.kinds import TIES, Cure, cures, shares, usual
from ...plan.choice.pick import Design, Limits, State, best_first, exchange, greedy
from ...plan.choice.views import Sites, Views, limits, slots, views
from ...plan.scenario import Scenario
from ...plan.scene import epochs_ns
from ...table.phases import OrbitPhase, even_motion

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NOTHING = DEG
"""Sigma about each axis of a mounting of which nothing is known."""
FEW = 4
"""Images of each kind that may cure what is badly determined."""
WORK = 300_000
"""Images times candidates up to which exchanges go on until none gains; with more each image is looked at once."""
SWEEPS = 5
"""So many times at most."""
LITTLE_WORK, BEGINNINGS = 6_000, 12
"""Images times candidates up to which so many first images are tried."""
MOST_TIED, MOST_SIGHTINGS = 40, 1500
"""Images, and sightings with the tie points in them, up to which tie points are looked at: a second of computing."""
WATCHED = 24
"""Images after each of which the detectable motion is found; of more, after so many of them."""


@dataclass(frozen=True)
class Asked:
    """At most ``count`` images until ``sigma`` rad about each axis (0: all of them), from ``start_s`` to ``end_s``
    after the epoch of the stage, with ``P_theta`` (3, 3) rad^2 known of the mounting, None for nothing."""

    count: int
    sigma: float
    start_s: float
    end_s: float
    P_theta: Array | None


@dataclass(frozen=True)
class Choice:
    """The images chosen, the one that is worth most first, and the covariance (3, 3) of the mounting after each.

    ``design`` counts a view by its chance of being clear, ``information`` whole.
    """

    stage: Stage
    sites: Sites
    views: Views
    limits: Limits
    information: Information
    design: Design
    asked: Asked
    picks: tuple[int, ...]
    known: tuple[Array, ...]
    certificate: Certificate

    @cached_property
    def scenario(self) -> Scenario:
        """The chosen images as a scenario, with every source of error as it is."""
        return chosen_scenario(self.stage, self.views, self.sites, np.array(self.picks))

    @cached_property
    def checked_E(self) -> Array:
        """Covariance (3, 3) of the mounting by the whole noise model, all chosen images being clear."""
        return np.linalg.inv(np.linalg.inv(bound_E(self.scenario)) + np.linalg.inv(self.design.P_theta))

    @cached_property
    def cameras(self) -> dict[str, Array]:
        """Of several cameras the covariance (3, 3) of the mounting of each further one against the first after all
        images and what is known of the first one before, by the whole noise model; nothing of one, or where they are
        too many to say."""
        optics = self.stage.config.optics
        if len(optics) < 2 or len(self.picks) > MOST_TIED:
            return {}
        found = of_all_cameras(self.stage, self.views, self.sites, np.array(self.picks))
        rig = None if found is None else found.campaign.rig
        if found is None or rig is None or found.truth.n > MOST_SIGHTINGS:
            return {}
        information = np.linalg.inv(bound_E(found))
        information[:3, :3] += np.linalg.inv(self.design.P_theta)
        P = np.linalg.inv(information).reshape(len(rig.names), 3, len(rig.names), 3)
        return {
            name: P[k, :, k] + P[0, :, 0] - P[k, :, 0] - P[0, :, k]
            for k, name in enumerate(rig.names)
            if k > 0
        }

    @cached_property
    def clear_E(self) -> Array:
        """The same by the sums that images are chosen by."""
        return covariance(Design(self.information, self.design.P_theta, self.design.W), list(self.picks))

    def rms(self, P: Array) -> float:
        """Error on the ground, m, of a mounting known with the covariance P (3, 3)."""
        return float(np.sqrt(self.design.value(P)))

    @cached_property
    def usual(self) -> tuple[int, ...]:
        """As many views of the usual kind, the best of them."""
        return tuple(usual(self.design, self.views, self.limits, len(self.picks)))

    @cached_property
    def before(self) -> tuple[int, ...]:
        """What there is before: nothing where a mounting is given, else as many views of the usual kind."""
        return () if self.asked.P_theta is not None else self.usual

    @cached_property
    def before_E(self) -> Array:
        return covariance(self.design, list(self.before))

    @cached_property
    def cures(self) -> tuple[Cure, ...]:
        """What a few more images of each kind are worth, and tie points in those that there are; the best first."""
        found = cures(self.design, self.views, self.limits, list(self.before), FEW)
        P = self.tied(self.before)
        ties = () if P is None else (Cure(TIES, 0, self.design.value(P)),)
        return tuple(sorted((*found, *ties), key=lambda cure: cure.value))

    def tied(self, picks: tuple[int, ...]) -> Array | None:
        """Covariance (3, 3) of the mounting after some images, were there tie points at each site too; None where no
        two of them are of one site, or they are too many to say."""
        sites = self.views.site[list(picks)]
        if np.unique(sites).size == sites.size or len(picks) > MOST_TIED:
            return None
        found = tied_scenario(self.stage, self.views, self.sites, np.array(picks))
        if found.truth.n > MOST_SIGHTINGS:
            return None
        return np.linalg.inv(np.linalg.inv(bound_E(found)) + np.linalg.inv(self.design.P_theta))

    def shares(self, picks: tuple[int, ...], axis_E: Array) -> dict[str, float]:
        """By which part the variance along an axis would fall after some images, were a source known."""
        return shares(self.design.information, self.design, list(picks), axis_E) if picks else {}

    @cached_property
    def detectable(self) -> tuple[float | None, ...]:
        """Amplitude, rad, of the motion that would be found after each image; None for too few, and between those that
        are looked at."""
        v, t_ns = self.views, epochs_ns(self.stage.epoch_ns, self.views.time_s)
        n = len(self.picks)
        at = set(np.unique(np.linspace(1, n, min(n, WATCHED)).astype(np.int64)).tolist())
        orbit = self._orbit(t_ns)
        found: list[float | None] = []
        for k in range(1, n + 1):
            mine = sorted(self.picks[:k])
            when = When(t_ns[mine], v.u[mine])
            found.append(detectable(self.design, mine, when, orbit) if k in at else None)
        return tuple(found)

    def _orbit(self, t_ns: Index) -> OrbitPhase | None:
        r_I, v_I = self.stage.orbit.at(self.views.time_s[:1])
        rate = float(np.linalg.norm(np.cross(r_I[0], v_I[0])) / np.sum(r_I[0] ** 2))
        mine = np.sort(np.array(self.picks))
        return even_motion(t_ns[mine], self.views.u[mine], rate)


def covariance(design: Design, picks: list[int]) -> Array:
    """Covariance (3, 3) of the mounting after some images."""
    mine = Design(design.information.only(np.array(picks, dtype=np.int64)), design.P_theta, design.W)
    if not picks:
        return design.P_theta
    state = State(mine)
    for j in range(len(picks)):
        state.change(j)
    return state.P[:3, :3]


def choose(stage: Stage, sites: Sites, asked: Asked) -> Choice:
    """The images to take.  Raises InputError where no view of the span is possible."""
    able = agility(stage.config, stage.camera.scans)
    span = (asked.start_s, asked.end_s)
    found = views(stage.orbit, stage.orientation, stage.epoch_ns, span, sites, able)
    if found.n == 0:
        raise InputError(
            f"found no view of {', '.join(sites.names[:3])} in the span of {(span[1] - span[0]) / 86400.0:g} days, "
            "wanted a longer span, other sites, a lower Sun (plan.min_sun_deg) or a wider look (plan.max_look_deg)"
        )
    P = np.eye(3) * NOTHING**2 if asked.P_theta is None else asked.P_theta
    whole = candidate_information(stage, found, sites, P)
    W = ground_weight(stage.camera, stage.C_EK, height_of(stage, float(found.time_s[0])))
    design = Design(whole.weighted(sites.clear[found.site]), P, W)
    clash = limits(found, able, stage.exposed_s)
    picks = picked(design, clash, asked.count, asked.sigma)
    if not picks:
        have = float(np.sqrt(np.max(np.diagonal(P)))) / ARCSEC
        raise InputError(
            f"found a target of {asked.sigma / ARCSEC:g} arcsec that is met before the first image ({have:.3g} arcsec "
            "about the axis known worst), wanted a smaller one"
        )
    room = Room(len(picks), slots(found, able, stage.exposed_s), found.pass_of, able.per_pass)
    start = np.zeros(found.n)
    start[picks] = 1.0
    order, known = best_first(design, picks)
    proof = certificate(design, room, start)
    return Choice(stage, sites, found, clash, whole, design, asked, tuple(order), tuple(known), proof)


def picked(design: Design, clash: Limits, count: int, sigma: float = 0.0) -> list[int]:
    """The best images one after another, then exchanged; of few candidates from several beginnings."""
    start = State(design)
    size = count * design.information.n
    state = start.copy()
    picks = greedy(state, clash, count, sigma=sigma)
    found = [(exchange(state, clash, picks, SWEEPS if size <= WORK else 1), state.value)]
    if size <= LITTLE_WORK:
        for j in np.argsort(-start.gains())[1:BEGINNINGS].tolist():
            state = start.copy()
            picks = greedy(state, clash, len(found[0][0]), first=[j])
            if len(picks) == len(found[0][0]):
                found.append((exchange(state, clash, picks, SWEEPS), state.value))
    return min(found, key=lambda one: one[1])[0]
