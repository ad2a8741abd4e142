"""What the images alone say of the alignment, of each source of error, and the interval that their scatter supports.

The sightings of an image fix a rotation d of the answer; its covariance has a part of each source: of the attitude
about the axis that trackers know worst and across it (with the orbit's), and of the sightings, whose factor follows
from the residuals within the images as well.  Images of one pass or session may share an error that nobody stated.
One factor each is estimated (:mod:`starplumb.judge.scatter.variances`).  The answer keeps its stated weights: with its
gain G the variance is ``sum_s f_s G V_s G^T``, with Satterthwaite's degrees of freedom ``2 v^2 / var(v)``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics.covariance import square_root
from ...physics.units import ARCSEC
from . import variances
from .next_session import NextSession, next_session
from .rotations import ImageRotations
from .times import TimesFound, times_found
from .variances import Component, Factors, Projector

Array = NDArray[np.float64]
Index = NDArray[np.int64]

AT_MOST = 300
"""Images from which factors are estimated, spread evenly; all if there are no more."""
FEWEST = 3
"""Images from whose scatter a sigma can be told at all."""
SEVERAL = 6
"""Passes or sessions from which on what their images share is estimated about the weak axis by itself."""
WEAK_AXIS = 1.5
"""Variance of the attitude about one axis, over that about the next, from which that axis is its weak one."""
RESTS = 0.1
"""Share of the answer's variance about an axis from which it rests on a source."""
REFUTED_P = 1e-4
"""Probability below which the scatter contradicts even a source of which the images have one draw."""
SHARE = 0.2
"""Share of the variance across from which the orbit is named beside the attitude."""
ACROSS, ABOUT, SIGHTINGS, SESSION = "across", "about", "sightings", "session"
SESSIONS = "attitude session"
"""What the table calls the errors that are stated of sessions."""


def components(
    images: ImageRotations, C_EK: Array, levels: Mapping[str, Index], *, estimated: bool = False
) -> tuple[Component, ...]:
    """The sources of the scatter of images; ``levels`` names what images may share unstated, and which of them (m,).

    The error stated of a session is a source of its own where it is ``estimated``.
    """
    of_attitude = np.array([name.startswith("attitude") for name in images.common_of], dtype=np.bool_)
    of_session = np.array([estimated and name == SESSIONS for name in images.common_of], dtype=np.bool_)
    D, others = (_narrowed(images.common[..., some]) for some in (of_attitude & ~of_session, ~of_attitude))
    mean = np.mean(images.attitude_E + D @ D.mT, axis=0)
    own = images.sightings_E - images.landmarks @ images.landmarks.mT
    found, about = [], np.zeros((3, 3))
    if np.any(mean):
        about = _about(mean, _axis(mean, C_EK))
        across = np.eye(3) - about
        found.append(Component(ABOUT, about @ images.attitude_E @ about.T, about @ D))
        rest = np.concatenate([across @ D, others], axis=-1)
        found.append(Component(ACROSS, across @ images.attitude_E @ across.T + images.position_E, rest))
    elif np.any(images.position_E) or others.size:
        found.append(Component(ACROSS, images.position_E, others))
    within = Component(SIGHTINGS, own, images.landmarks, 1.0, images.squares, images.degrees)
    root = square_root(mean + np.mean(images.position_E, axis=0))
    found += _of_level(SESSION, images.common[..., of_session], about, 1.0)
    unstated = [c for k, groups in levels.items() for c in _of_level(k, _columns(root, groups), about, 0.0)]
    kept = [c for c in found if np.any(c.own) or np.any(c.common)]
    return (*kept, within, *(c for c in unstated if np.any(c.common)))


def _narrowed(Z: Array) -> Array:
    """Columns (m, 3, c) of the same covariance, of which there are no more than rows: attitude samples are many."""
    rows = Z.reshape(3 * len(Z), Z.shape[-1])
    if rows.shape[1] <= len(rows):
        return Z
    axes, sizes, _ = np.linalg.svd(rows, full_matrices=False)
    return np.asarray((axes * sizes).reshape(len(Z), 3, -1))


def _of_level(name: str, Z: Array, about: Array, stated: float) -> list[Component]:
    """What images share by columns Z (m, 3, 3 groups); of several groups about the weak axis by itself."""
    none, apart = np.zeros((len(Z), 3, 3)), about @ Z
    sizes = np.max(np.abs(Z - apart), initial=0.0), np.max(np.abs(apart), initial=0.0)
    if Z.shape[-1] < 3 * SEVERAL or min(sizes) < 0.03 * max(sizes):  # a part found to be 0 is no source
        return [Component(name, none, Z, stated, drawn_anew=True)]
    parts = {name: Z - apart, f"{name}, about the weak axis": apart}
    return [Component(words, none, part, stated, drawn_anew=True) for words, part in parts.items()]


def _axis(mean: Array, C_EK: Array) -> Array:
    """The axis (3,) about which an attitude of this covariance is known worst, the camera's boresight if none stands
    out."""
    values, axes = np.linalg.eigh(mean)
    return axes[:, 2] if values[2] > WEAK_AXIS * values[1] else C_EK[:, 2]


def _about(mean: Array, axis: Array) -> Array:
    """Projector (3, 3) of an attitude error on its part about an axis, uncorrelated with what is left."""
    along = mean @ axis
    return np.asarray(np.outer(along, axis) / (axis @ along))


def _columns(root: Array, groups: Index) -> Array:
    """One draw with this square root (3, 3) for each group: (m, 3, 3 groups)."""
    number = np.unique(groups, return_inverse=True)[1]
    Z = np.zeros((groups.size, 3, int(number.max()) + 1, 3))
    Z[np.arange(groups.size), :, number] = root
    return Z.reshape(groups.size, 3, -1)


@dataclass(frozen=True)
class SourceFound:
    """What the data say of one source of error: its sigma as ``stated`` in ``unit`` (0 for one that is not stated), as
    ``found``, and the ``ratio`` of the two with its 95 % ``interval``; ``p`` is the probability of at least such a
    scatter if it is as stated."""

    kind: str
    name: str
    unit: str
    stated: float
    found: float
    ratio: float | None
    interval: tuple[float, float] | None
    p: float


@dataclass(frozen=True)
class FromData:
    """What the scatter of images supports: ``sigma_E`` (3,) rad of the answer with ``degrees`` (3,) of freedom, None
    where they are too few, and the ``sources``; ``jackknife_E`` (3,) rad is a rough sigma that knows no source, from
    leaving out one ``left`` after another; ``times`` is what the scatter says of the times of images, ``next_session``
    what it says of the mounting at a further session or pass.  Sources that are ``single``, one draw for all images,
    are none of those told, and where the answer rests on them no sigma is."""

    images: int
    sigma_E: Array | None
    degrees: Array | None
    sources: tuple[SourceFound, ...]
    jackknife_E: Array | None = None
    left: str = "image"
    times: TimesFound | None = None
    next_session: NextSession | None = None
    single: tuple[str, ...] = ()

    @property
    def half_95_E(self) -> Array | None:
        """Half-widths (3,) rad of the 95 % intervals by Student's t."""
        from ...solve.probability import stdtrit

        if self.sigma_E is None or self.degrees is None:
            return None
        return np.asarray(self.sigma_E * stdtrit(self.degrees, 0.975))


def from_data(
    images: ImageRotations,
    C_EK: Array,
    sigma_E: Array,
    levels: Mapping[str, Index] | None = None,
    *,
    estimated: bool = False,
) -> FromData:
    """What the scatter of the images says of an answer with the stated sigmas ``sigma_E`` (3,) rad.

    ``levels`` has groups of the images (m,) by what they belong to, such as a pass; ``estimated`` says that the error
    stated of a session is itself from the data.
    """
    some, levels = images.some(AT_MOST), levels or {}
    if some is not images:
        levels = {name: g[np.searchsorted(images.image, some.image)] for name, g in levels.items()}
    sources = components(some, C_EK, levels, estimated=estimated)
    p = variances.probabilities(some.d_E, sources)
    stated = np.array([c.stated for c in sources])
    as_stated = Projector(sources, stated)
    gain, times = as_stated.gain, times_found(as_stated, some.d_E, some.per_second_E)
    held = np.array([c.single for c in sources]) & ~(p < REFUTED_P)  # p may be no number
    factors = variances.estimate(some.d_E, sources, held)
    named = tuple(_found(some, c, factors, k, float(p[k])) for k, c in enumerate(sources) if not held[k])
    slopes = np.array([np.diagonal(c.spread(gain)) for c in sources])
    rests = held & np.any(slopes > RESTS * (stated @ slopes), axis=1)
    single = tuple(_words(some, c) for c, one in zip(sources, rests, strict=True) if one)
    if some.size < FEWEST or single:
        return FromData(images.size, None, None, named, times=times, single=single)
    variance, degrees = variances.satterthwaite(slopes, factors)
    scale = sigma_E / np.sqrt(stated @ slopes)  # whatever else the answer rests on scales alike
    left, groups = next(iter(levels.items()), ("image", np.arange(some.size)))
    if np.unique(groups).size < FEWEST:
        left, groups = "image", np.arange(some.size)
    rough = _jackknife(some.d_E, gain, groups) * scale
    further = next_session(some.d_E, sources, factors, slopes * scale**2)
    return FromData(images.size, np.sqrt(variance) * scale, degrees, named, rough, left, times, further)


def _found(images: ImageRotations, c: Component, factors: Factors, k: int, p: float) -> SourceFound:
    """One source in words and in its unit."""
    from ...solve.probability import chdtri

    variance = np.mean(np.trace(c.own + c.common @ c.common.mT, axis1=-2, axis2=-1))
    axes = {ABOUT: 1, ACROSS: 2}.get(c.name, 3)
    size, unit = float(np.sqrt(variance / axes)) / ARCSEC, "arcsec"
    if c.name == SIGHTINGS:
        size, unit = images.sigma_px, "px"
    f, freedom = float(factors.f[k]), max(float(factors.degrees[k]), 1.0)
    ratio = float(np.sqrt(f))
    if c.stated == 0.0:
        return SourceFound(c.name, _words(images, c), unit, 0.0, ratio * size, None, None, p)
    low, high = (float(np.sqrt(f * freedom / chdtri(freedom, q))) for q in (0.025, 0.975))
    return SourceFound(c.name, _words(images, c), unit, size, ratio * size, ratio, (low, high), p)


def _words(images: ImageRotations, c: Component) -> str:
    if c.name == ABOUT:
        return "attitude about its weak axis"
    if c.name == SIGHTINGS:
        return "sightings (image measurement and survey)"
    if c.name != ACROSS:
        level, _, axis = c.name.partition(",")
        return f"what the images of a {level} share{axis}"
    total = np.sum(np.trace(c.own + c.common @ c.common.mT, axis1=-2, axis2=-1))
    others = [not name.startswith("attitude") for name in images.common_of]
    orbit = np.sum(np.trace(images.position_E, axis1=-2, axis2=-1)) + np.sum(images.common[..., others] ** 2)
    if orbit > (1.0 - SHARE) * total:
        return "position"
    return "attitude and position across" if orbit > SHARE * total else "attitude across its weak axis"


def _jackknife(d: Array, gain: Array, groups: Index) -> Array:
    """Standard deviations (3,) of ``sum G d`` from leaving out one group after another."""
    number = np.unique(groups, return_inverse=True)[1]
    J = int(number.max()) + 1
    weights, moved = np.zeros((J, 3, 3)), np.zeros((J, 3))
    np.add.at(weights, number, gain)
    np.add.at(moved, number, (gain @ d[..., None])[..., 0])
    rest = np.linalg.solve(np.sum(gain, axis=0) - weights, (np.sum(moved, axis=0) - moved)[..., None])[..., 0]
    return np.asarray(np.sqrt((J - 1.0) / J * np.sum((rest - np.mean(rest, axis=0)) ** 2, axis=0)))


def levels_of(images: ImageRotations, groups: Sequence[tuple[str, Index]]) -> dict[str, Index]:
    """Of named groups (all images,), those by which images that fix a rotation can be told apart: two groups or more,
    one of them with two images or more; the same groups once."""
    found: dict[str, Index] = {}
    for name, group in groups:
        _, first, number = np.unique(group[images.image], return_index=True, return_inverse=True)
        number = np.argsort(np.argsort(first))[
            number
        ]  # in the order of their first images, whatever their names
        known = any(np.array_equal(number, other) for other in found.values())
        if 1 < number.max() + 1 < number.size and not known:
            found[name] = number
    return found
