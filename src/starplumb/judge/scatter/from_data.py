"""What the images alone say of the alignment, of each source of error, and the interval that their scatter supports.

The sightings of an image fix a rotation d of the answer; its covariance has a part of each source: of the attitude
about the axis that trackers know worst and across it (with the orbit's), and of the sightings, whose factor follows
from the residuals within the images as well.  Images of one pass or session may share an error that nobody stated.
One factor each is estimated (:mod:`starplumb.judge.scatter.variances`).  The answer keeps its stated weights: with its
gain G the variance is ``sum_s f_s G V_s G^T``, with Satterthwaite's degrees of freedom ``2 v^2 / var(v)``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...estimators.fit import Fit
from ...estimators.image_sums import ImageSums, image_sums
from ...physics.covariance import square_root
from ...physics.units import ARCSEC
from ...solve.chunks import repeated_landmarks
from ...solve.problem import Linear
from ...solve.whitening import sums
from ...table.equation import Linearised
from ...table.observations import Observations
from . import variances
from .times import TimesFound, times_found
from .variances import Component, Factors, Projector

Array = NDArray[np.float64]
Index = NDArray[np.int64]

AT_MOST = 300
"""Images from which factors are estimated, spread evenly; all if there are no more."""
FEWEST = 3
"""Images from whose scatter a sigma can be told at all."""
LANDMARKS_AT_MOST = 100
"""Landmarks seen again whose errors images are taken to share; more of them count as the images' own."""
SEVERAL = 8
"""Passes or sessions from which on what their images share is estimated about the weak axis by itself."""
WEAK_AXIS = 1.5
"""Variance of the attitude about one axis, over that about the next, from which that axis is its weak one."""
SHARE = 0.2
"""Share of the variance across from which the orbit is named beside the attitude."""
ACROSS, ABOUT, SIGHTINGS, SESSION = "across", "about", "sightings", "session"
SESSIONS = "attitude session"
"""What the table calls the errors that are stated of sessions."""


@dataclass(frozen=True)
class ImageRotations:
    """Rotations ``d_E`` (m, 3) rad of the answer that each image alone would make, and their stated covariance by
    source (m, 3, 3): sightings, attitude and position.

    ``common`` (m, 3, p) is what the errors in common, named ``common_of``, do to them, ``landmarks`` (m, 3, 3 q) what
    those of landmarks seen again do, which is part of ``sightings_E`` too, and ``per_second_E`` (m, 3) rad/s what a
    time too late does.  ``squares`` is the sum of the weighted
    squares within the images, with ``degrees`` of freedom; ``image`` (m,) are the images, ``sigma_px`` that of their
    sightings.
    """

    image: Index
    d_E: Array
    sightings_E: Array
    attitude_E: Array
    position_E: Array
    common: Array
    landmarks: Array
    per_second_E: Array
    common_of: tuple[str, ...]
    squares: float
    degrees: int
    sigma_px: float

    @property
    def size(self) -> int:
        return len(self.d_E)

    def some(self, most: int) -> ImageRotations:
        """So many of them, spread evenly."""
        if self.size <= most:
            return self
        k = np.linspace(0, self.size - 1, most).astype(np.int64)
        return replace(self, **{name: getattr(self, name)[k] for name in _PER_IMAGE})


_PER_IMAGE = (
    "image",
    "d_E",
    "sightings_E",
    "attitude_E",
    "position_E",
    "common",
    "landmarks",
    "per_second_E",
)


def image_rotations(fit: Fit) -> ImageRotations | None:
    """Of the images used that fix a rotation; None for fewer than two."""
    o = fit.table
    again = repeated_landmarks(o)
    place = np.full(o.n_landmarks, -1)
    if again.size <= LANDMARKS_AT_MOST:
        place[again] = np.arange(again.size)
    found = [_of_part(linear, place) for _, linear in fit.parts()]
    columns: list[Any] = [np.concatenate([one[k] for one in found]) for k in range(len(_PER_IMAGE))]
    if len(columns[0]) < 2:
        return None
    names = o.common_of or ("",) * columns[5].shape[-1]
    squares, degrees = (sum(one[k] for one in found) for k in (-2, -1))
    sigma = float(np.sqrt(np.mean(o.sigma_px**2)))
    fields = dict(zip(_PER_IMAGE, columns, strict=True))
    return ImageRotations(
        **fields, common_of=names, squares=float(squares), degrees=int(degrees), sigma_px=sigma
    )


def _of_part(linear: Linear, place: Index) -> tuple[Any, ...]:
    """The arrays of :class:`ImageRotations` of some images, squares and degrees; ``place`` (L,) numbers the landmarks
    whose errors are shared."""
    o, model, _ = linear
    sums_of = image_sums(o, model, np.flatnonzero(o.weight > 0.0), model.z_px)
    fixed, rows = sums_of.fixed, sums_of.rows
    image, b = sums_of.image[fixed], sums_of.b[fixed]
    Q = np.linalg.inv(sums_of.N[fixed])
    gain = Q @ sums_of.toward[fixed]
    common = np.zeros((image.size, 3, 0))
    if o.common_px is not None:
        common = -(Q @ sums_of.of(sums_of.HW @ o.common_px[rows])[fixed])
    landmarks = Q @ _of_landmarks(o, model, sums_of, place)[fixed]
    moved = model.H[rows] @ o.omega_E[rows, :, None] - model.R[rows] @ o.v_J[rows, :, None]
    per_second = Q @ sums_of.of(sums_of.HW @ moved)[fixed]
    squares = np.sum(sums_of.squares[fixed] - (b.mT @ Q @ b)[:, 0, 0])
    position = gain @ o.cov_position_J[image] @ gain.mT
    degrees = np.sum(2 * sums_of.count[fixed] - 3)
    d_E, attitude = -(Q @ b)[..., 0], o.cov_attitude_E[image]
    return image, d_E, Q, attitude, position, common, landmarks, per_second[..., 0], squares, degrees


def _of_landmarks(o: Observations, model: Linearised, images: ImageSums, place: Index) -> Array:
    """What the errors of the landmarks whose number ``place`` (L,) is not negative do to each image (m, 3, 3 q)."""
    m, q, rows = images.image.size, int(np.max(place, initial=-1)) + 1, images.rows
    if not q:
        return np.zeros((m, 3, 0))
    number = np.repeat(np.arange(m), images.count)
    seen = place[o.landmark[rows]]
    shared = np.flatnonzero(seen >= 0)
    root = square_root(o.cov_landmark_J[o.landmark[rows[shared]]])
    by_pair = sums(images.HW[shared] @ model.R[rows[shared]] @ root, number[shared] * q + seen[shared], m * q)
    return np.moveaxis(by_pair.reshape(m, q, 3, 3), 1, 2).reshape(m, 3, 3 * q)


def components(
    images: ImageRotations, C_EK: Array, levels: Mapping[str, Index], *, estimated: bool = False
) -> tuple[Component, ...]:
    """The sources of the scatter of images; ``levels`` names what images may share unstated, and which of them (m,).

    The error stated of a session is a source of its own where it is ``estimated``.
    """
    of_attitude = np.array([name.startswith("attitude") for name in images.common_of], dtype=np.bool_)
    of_session = np.array([estimated and name == SESSIONS for name in images.common_of], dtype=np.bool_)
    D, others = images.common[..., of_attitude & ~of_session], images.common[..., ~of_attitude]
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


def _of_level(name: str, Z: Array, about: Array, stated: float) -> list[Component]:
    """What images share by columns Z (m, 3, 3 groups); of several groups about the weak axis by itself."""
    none, apart = np.zeros((len(Z), 3, 3)), about @ Z
    sizes = np.max(np.abs(Z - apart), initial=0.0), np.max(np.abs(apart), initial=0.0)
    if Z.shape[-1] < 3 * SEVERAL or min(sizes) < 0.03 * max(sizes):  # a part found to be 0 is no source
        return [Component(name, none, Z, stated)]
    weak = f"{name}, about the weak axis"
    return [Component(name, none, Z - apart, stated), Component(weak, none, apart, stated)]


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
    leaving out one ``left`` after another; ``times`` is what the scatter says of the times of images."""

    images: int
    sigma_E: Array | None
    degrees: Array | None
    sources: tuple[SourceFound, ...]
    jackknife_E: Array | None = None
    left: str = "image"
    times: TimesFound | None = None

    @property
    def half_95_E(self) -> Array | None:
        """Half-widths (3,) rad of the 95 % intervals by Student's t."""
        from scipy.special import stdtrit

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
    factors = variances.estimate(some.d_E, sources)
    named = tuple(_found(some, c, factors, k, float(p[k])) for k, c in enumerate(sources))
    if some.size < FEWEST:
        return FromData(images.size, None, None, named, times=times)
    slopes = np.array([np.diagonal(c.spread(gain)) for c in sources])
    variance, degrees = _satterthwaite(slopes, factors)
    scale = sigma_E / np.sqrt(stated @ slopes)  # whatever else the answer rests on scales alike
    left, groups = next(iter(levels.items()), ("image", np.arange(some.size)))
    if np.unique(groups).size < FEWEST:
        left, groups = "image", np.arange(some.size)
    rough = _jackknife(some.d_E, gain, groups) * scale
    return FromData(images.size, np.sqrt(variance) * scale, degrees, named, rough, left, times)


def _satterthwaite(slopes: Array, factors: Factors) -> tuple[Array, Array]:
    """Variance (3,) and degrees of freedom (3,) of ``f^T slopes``; factors that are 0 stay out."""
    on = factors.f > 0.0
    variance = factors.f @ slopes
    spread = np.einsum("si,st,ti->i", slopes[on], factors.spread[np.ix_(on, on)], slopes[on])
    return variance, np.clip(2.0 * variance**2 / np.maximum(spread, 1e-300), 1.0, variances.MOST_DEGREES)


def _found(images: ImageRotations, c: Component, factors: Factors, k: int, p: float) -> SourceFound:
    """One source in words and in its unit."""
    from scipy.special import chdtri

    variance = np.mean(np.trace(c.own + c.common @ c.common.mT, axis1=-2, axis2=-1))
    axes = {ABOUT: 1, ACROSS: 2}.get(c.name, 3)
    size, unit = float(np.sqrt(variance / axes)) / ARCSEC, "arcsec"
    if c.name == SIGHTINGS:
        size, unit = images.sigma_px, "px"
    f, freedom = float(factors.f[k]), max(float(factors.degrees[k]), 0.1)
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
        number = np.unique(group[images.image], return_inverse=True)[1]
        known = any(np.array_equal(number, other) for other in found.values())
        if 1 < number.max() + 1 < number.size and not known:
            found[name] = number
    return found
