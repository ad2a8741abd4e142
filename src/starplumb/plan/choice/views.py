"""The views that may be taken: passes over sites within a span, in the light, within reach, turned as asked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics.earth import C_JT, geodetic_to_itrf
from ...physics.errors import EpochError, InputError
from ...physics.orbit import C_RO, GM_EARTH, Orbit, argument_of_latitude
from ...physics.series import Orientation
from ...table.phases import sun_J
from ...table.sharing import chained
from .. import passes, scene
from .pick import Limits

Array = NDArray[np.float64]
Index = NDArray[np.int64]

STEP_S = 30.0
"""Step of the search for passes: a satellite moves by 2 deg in it, and is in reach of a site for longer."""
BURST_S = 1.0
"""What is simulated about an image on either side, s."""


@dataclass(frozen=True)
class Sites:
    """Places with markers: ``latitude``, ``longitude`` (S,) rad, ``height`` (S,) m, and the probability
    ``clear`` (S,) of a clear sky; the first is the home site."""

    names: tuple[str, ...]
    latitude: Array
    longitude: Array
    height: Array
    clear: Array

    @property
    def r_J(self) -> Array:
        return geodetic_to_itrf(self.latitude, self.longitude, self.height)

    def only(self, order: Index) -> Sites:
        """Some of them, in an order."""
        names = tuple(self.names[k] for k in order.tolist())
        return Sites(
            names, self.latitude[order], self.longitude[order], self.height[order], self.clear[order]
        )

    def and_(self, others: Sites) -> Sites:
        """These, then others."""
        pairs = (
            (self.latitude, others.latitude),
            (self.longitude, others.longitude),
            (self.height, others.height),
            (self.clear, others.clear),
        )
        return Sites((*self.names, *others.names), *(np.concatenate(pair) for pair in pairs))


@dataclass(frozen=True)
class Agility:
    """How the satellite can look: at most ``look`` rad off nadir, the Sun at least ``sun`` rad high, at ``pitch`` and
    ``yaw`` rad; a turn takes ``settle`` s and its angle over ``rate`` rad/s; at most ``per_pass`` images of a pass."""

    look: float
    sun: float
    pitch: Array
    yaw: Array
    rate: float
    settle: float
    per_pass: int


@dataclass(frozen=True)
class Views:
    """n views in the order of time: ``time_s`` after the epoch of the orbit, the site that they look at, the pass, the
    angles of the look (pitch ahead, roll to the left, turn about the boresight), rad, the height of the Sun, and the
    argument of latitude; ``C_IK`` (n, 3, 3)."""

    time_s: Array
    site: Index
    pass_of: Index
    pitch: Array
    roll: Array
    yaw: Array
    sun: Array
    u: Array
    aim_J: Array
    C_IK: Array

    @property
    def n(self) -> int:
        return self.time_s.size

    @property
    def look(self) -> Array:
        """Angle off nadir."""
        return np.arctan(np.hypot(np.tan(self.pitch), np.tan(self.roll)))

    def flight(self, chosen: Index) -> scene.Pass:
        """Some of them as images of a scene."""
        return scene.Pass(self.time_s[chosen], self.aim_J[chosen], self.yaw[chosen])


def views(
    orbit: Orbit,
    orientation: Orientation,
    epoch_ns: int,
    span_s: tuple[float, float],
    sites: Sites,
    agility: Agility,
) -> Views:
    """All views of the sites within a span.  Raises InputError where orbit or Earth orientation do not cover it."""
    try:
        orientation.C_IJ(scene.epochs_ns(epoch_ns, span_s))
        abeam, site = _abeam(orbit, orientation, epoch_ns, span_s, sites, agility.look)
    except EpochError as error:
        raise InputError(f"the span of the plan: {error}") from None
    angles = np.stack(np.meshgrid(agility.pitch, agility.yaw, indexing="ij"), axis=-1).reshape(-1, 2)
    near, where = np.repeat(abeam, len(angles)), np.repeat(site, len(angles))
    pitch, yaw = np.tile(angles, (abeam.size, 1)).T
    p_J = sites.r_J[where]
    time = passes.times_at_pitch(orbit, orientation, epoch_ns, near, p_J, pitch)
    roll = passes.look_angles(orbit, orientation, epoch_ns, time, p_J)[1]
    sun = sun_height(epoch_ns, time, sites, where)
    fits = (np.hypot(np.tan(pitch), np.tan(roll)) <= np.tan(agility.look)) & (sun >= agility.sun)
    fits &= (time >= span_s[0]) & (time <= span_s[1])
    order = np.flatnonzero(fits)[np.argsort(time[fits], kind="stable")]
    time, where, p_J, yaw = time[order], where[order], p_J[order], yaw[order]
    r_I, v_I = orbit.at(time)
    radius = float(np.median(np.linalg.norm(r_I, axis=-1))) if order.size else 7e6
    return Views(
        time,
        where,
        chained(time, np.pi * np.sqrt(radius**3 / GM_EARTH)) if order.size else where,
        pitch[order],
        roll[order],
        yaw,
        sun[order],
        argument_of_latitude(r_I, v_I),
        p_J,
        scene.aimed(orbit, orientation, epoch_ns, scene.Pass(time, p_J, yaw)),
    )


def _abeam(
    orbit: Orbit,
    orientation: Orientation,
    epoch_ns: int,
    span_s: tuple[float, float],
    sites: Sites,
    look: float,
) -> tuple[Array, Index]:
    """Times near which each site is abeam and within ``look`` rad, and the site of each."""
    time = np.arange(span_s[0] - STEP_S, span_s[1] + STEP_S, STEP_S)
    r_I, v_I = orbit.at(time)
    C_OJ = C_RO(r_I, v_I).mT @ orientation.C_IJ(scene.epochs_ns(epoch_ns, time))
    height = np.linalg.norm(r_I, axis=-1)
    found, site = [], []
    for k, p_J in enumerate(sites.r_J):
        x, y, z = (C_OJ @ p_J).T
        z = z + height
        at = np.flatnonzero((x[:-1] > 0.0) & (x[1:] <= 0.0))
        aside = np.minimum(np.abs(y[at]), np.abs(y[at + 1]))
        at = at[aside <= np.tan(look) * np.maximum(z[at], z[at + 1])]
        found.append(time[at] + STEP_S * x[at] / (x[at] - x[at + 1]))
        site.append(np.full(at.size, k))
    return np.concatenate(found), np.concatenate(site)


def sun_height(epoch_ns: int, time_s: Array, sites: Sites, site: Index) -> Array:
    """Height (n,) of the Sun over sites (n,), rad."""
    up = C_JT(sites.latitude[site], sites.longitude[site])[..., 2]
    sine = np.vecdot(up, sun_J(scene.epochs_ns(epoch_ns, time_s)))
    return np.asarray(np.arcsin(np.clip(sine, -1.0, 1.0)))


def limits(found: Views, agility: Agility, exposed_s: float) -> Limits:
    """Which views cannot both be taken: the satellite cannot turn from one to the other in time."""
    first, second = [], []
    longest = agility.settle + np.pi / agility.rate + exposed_s
    last = np.searchsorted(found.time_s, found.time_s + longest, side="right")
    for j in range(found.n):
        others = np.arange(j + 1, last[j])
        apart = found.time_s[others] - found.time_s[j] - exposed_s
        cosine = 0.5 * (np.einsum("ij,nij->n", found.C_IK[j], found.C_IK[others]) - 1.0)
        needed = agility.settle + np.arccos(np.clip(cosine, -1.0, 1.0)) / agility.rate
        clash = others[apart < np.maximum(needed, 2.0 * BURST_S + 0.25)]
        first += [np.full(clash.size, j), clash]
        second += [clash, np.full(clash.size, j)]
    a, b = (np.concatenate(x) if x else np.zeros(0, dtype=np.int64) for x in (first, second))
    order = np.argsort(a, kind="stable")
    return Limits(a[order], b[order], found.pass_of, agility.per_pass)


def slots(found: Views, agility: Agility, exposed_s: float) -> Index:
    """Numbers (n,) of times within which any two views clash, whatever their angles: by the least time between two."""
    least = exposed_s + max(agility.settle, 2.0 * BURST_S + 0.25)
    out, number, start = np.empty(found.n, dtype=np.int64), -1, -np.inf
    for j, t in enumerate(found.time_s.tolist()):
        if t - start >= least:
            number, start = number + 1, t
        out[j] = number
    return out


def layers(found: Views, exposed_s: float) -> list[Index]:
    """The views in sets within which no two overlap in time, so that each can be simulated as one flight."""
    ends: list[float] = []
    members: list[list[int]] = []
    for j, t in enumerate(found.time_s.tolist()):
        k = next((k for k, end in enumerate(ends) if t > end), len(ends))
        if k == len(ends):
            ends.append(0.0)
            members.append([])
        ends[k] = t + exposed_s + 2.0 * BURST_S + 0.25
        members[k].append(j)
    return [np.array(one) for one in members]
