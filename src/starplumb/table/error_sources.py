"""Error sources: what varies, who shares one draw of it, how it is distributed, what it does to a pixel.

Every source is one formula.  Element j of an error field (an image's attitude, a landmark's place, a sighting's
pixel...) is off by ``pattern_j diag(sigma) xi_g(j)``, where xi_g is drawn once for each group g of elements with mean 0
and variance 1.  White noise has a group for every element; an error of a pass, or of the campaign, one for all of its
images; a drift with the orbit or a correlated error one group and a pattern that varies from image to image.

This is the one noise model: simulator, bound and budget take sources, and the covariances that a table states are
sources too (:func:`stated_sources`); :func:`state` writes sources into a table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..physics.covariance import square_root
from ..physics.units import ARCSEC
from .equation import Linearised
from .observations import Observations

Array = NDArray[np.float64]
Index = NDArray[np.int64]

Field = Literal["alpha_E", "rho_J", "pi_J", "pixel", "late_s", "tangent", "turn_E"]
Shape = Literal["gaussian", "uniform", "student", "blunder", "disc"]


@dataclass(frozen=True)
class Unit:
    """A unit at the edge: its name in keys and tables, and what one of it is in SI."""

    name: str
    size: float


UNIT_ARCSEC = Unit("arcsec", ARCSEC)
UNIT_METRE = Unit("m", 1.0)
UNIT_PIXEL = Unit("px", 1.0)
UNIT_MILLISECOND = Unit("ms", 1e-3)
UNIT_PPM = Unit("ppm", 1e-6)
UNIT_PERCENT = Unit("percent", 0.01)


@dataclass(frozen=True)
class Distribution:
    """Shape of a draw of mean 0 and variance 1.

    ``disc`` draws pairs of coordinates uniformly from a disc, whose radius is 2 where each has variance 1.
    ``student`` has ``degrees_of_freedom`` above 2, scaled to variance 1.  A ``blunder`` happens to a group with
    probability ``rate`` and is then Gaussian with variance 1, else it is 0.
    """

    shape: Shape = "gaussian"
    degrees_of_freedom: float = 5.0
    rate: float = 0.0

    def draw(self, rng: np.random.Generator, size: tuple[int, ...]) -> Array:
        """Independent draws of this size (..., groups, q)."""
        if self.shape == "uniform":
            return np.asarray(np.sqrt(3.0) * (2.0 * rng.random(size) - 1.0))
        if self.shape == "student":
            nu = self.degrees_of_freedom
            return np.asarray(np.sqrt((nu - 2.0) / nu) * rng.standard_t(nu, size))
        if self.shape == "disc":
            radius, angle = 2.0 * np.sqrt(rng.random(size[:-1])), 2.0 * np.pi * rng.random(size[:-1])
            return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
        gaussian = rng.standard_normal(size)
        if self.shape == "blunder":
            return np.where(rng.random((*size[:-1], 1)) < self.rate, gaussian, 0.0)
        return gaussian


@dataclass(frozen=True)
class Source:
    """One source of error.

    ``pattern`` (..., J, d, q) over the J elements of ``field``, of d coordinates each; ``group`` (J,) the draw that an
    element takes; ``component`` (q,) which of the ``sigma`` (c,) (SI) scales each coordinate of a draw; ``labels`` (c,)
    name them.
    """

    name: str
    words: str
    field: Field
    pattern: Array
    group: Index
    component: Index
    sigma: Array
    labels: tuple[str, ...]
    unit: Unit
    distribution: Distribution = Distribution()

    @property
    def gain(self) -> Array:
        """What a draw does to each element, (..., J, d, q) in the field's unit."""
        return np.asarray(self.pattern * self.sigma[self.component])

    @property
    def groups(self) -> int:
        return int(self.group.max(initial=-1)) + 1

    @property
    def is_white(self) -> bool:
        """Whether every element has a draw of its own."""
        return np.array_equal(self.group, np.arange(self.group.size))

    @property
    def is_blunder(self) -> bool:
        return self.distribution.shape == "blunder"

    def scaled(self, factor: float) -> Source:
        """The same with all its sigmas multiplied."""
        return replace(self, sigma=factor * self.sigma)

    def draw(self, rng: np.random.Generator, batch: tuple[int, ...]) -> Array:
        """Errors of the field, (..., J, d)."""
        return self.error(self.distribution.draw(rng, (*batch, self.groups, self.component.size)))

    def error(self, xi: Array) -> Array:
        """Errors (..., J, d) that draws (..., groups, q) amount to."""
        gain = self.gain
        taken = xi if self.is_white else xi[..., self.group, :]
        batch = np.broadcast_shapes(xi.shape[:-2], gain.shape[:-3])
        total = np.zeros((*batch, *gain.shape[-3:-1]))
        for i, k in np.argwhere(np.any(gain, axis=tuple(range(gain.ndim - 2)))):
            total[..., i] += gain[..., i, k] * taken[..., k]
        return total


@dataclass(frozen=True)
class Errors:
    """Errors of one or many runs: measured = true + error, of a rotation exp(error) times it.

    ``alpha_E`` (..., m, 3) rad attitude of each image; ``rho_J`` (..., m, 3) m position of each image;
    ``pi_J`` (..., L, 3) m place of each landmark; ``pixel`` (..., n, 2) column and row of each sighting;
    ``late_s`` (..., m) s by which attitude and position of an image are read too late; ``tangent`` (..., n, 2) error of
    the look direction xy_K that the camera model gives a sighting's pixel; ``turn_E`` (..., n, 3) rad attitude of each
    sighting, besides that of its image.  None for no such error.
    """

    alpha_E: Array
    rho_J: Array
    pi_J: Array
    pixel: Array
    late_s: Array | None = None
    tangent: Array | None = None
    turn_E: Array | None = None

    @classmethod
    def draw(cls, truth: Observations, rng: np.random.Generator, batch: tuple[int, ...] = ()) -> Errors:
        """Gaussian errors as the table states them."""
        return draw(truth, stated_sources(truth), rng, batch)

    def only(self, source: str) -> Errors:
        """The errors of one source, a field's name, alone."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return Errors(**{n: v if n == source or v is None else np.zeros_like(v) for n, v in values.items()})


def combine(truth: Observations, fields: Sequence[tuple[Field, Array]]) -> Errors:
    """Errors of a scene from the errors (..., J, d) of its sources, field by field."""
    sums: dict[str, Array] = {}
    for field, error in fields:
        sums[field] = sums[field] + error if field in sums else error
    m, L, n = truth.n_images, truth.n_landmarks, truth.n
    late = sums.get("late_s")
    return Errors(
        alpha_E=sums.get("alpha_E", np.zeros((m, 3))),
        rho_J=sums.get("rho_J", np.zeros((m, 3))),
        pi_J=sums.get("pi_J", np.zeros((L, 3))),
        pixel=sums.get("pixel", np.zeros((n, 2))),
        late_s=None if late is None else late[..., 0],
        tangent=sums.get("tangent"),
        turn_E=sums.get("turn_E"),
    )


def draw(
    truth: Observations, sources: Sequence[Source], rng: np.random.Generator, batch: tuple[int, ...]
) -> Errors:
    """Errors of all sources, drawn one source after another."""
    return combine(truth, [(source.field, source.draw(rng, batch)) for source in sources])


def stated_sources(table: Observations) -> tuple[Source, ...]:
    """The errors that a table states, as sources: what each image, landmark and sighting has of its own, and, where
    there is ``common_px``, what any other set of sightings shares.

    The covariances are in the patterns, so that each sigma is 1.
    """
    m, L, n = table.n_images, table.n_landmarks, table.n
    own = (
        as_stated("attitude", "alpha_E", square_root(table.cov_attitude_E), np.arange(m)),
        as_stated("position", "rho_J", square_root(table.cov_position_J), np.arange(m)),
        as_stated("landmark", "pi_J", square_root(table.cov_landmark_J), np.arange(L)),
        as_stated("pixel", "pixel", table.noise_root_px, np.arange(n)),
    )
    if table.common_px is None:
        return own
    # common_px is in residuals, predicted minus measured pixel
    return (*own, as_stated("common", "pixel", -table.common_px, np.zeros(n, dtype=np.int64)))


def as_stated(name: str, field: Field, pattern: Array, group: Index) -> Source:
    """A source whose sigmas are in its pattern (..., J, d, q)."""
    q = pattern.shape[-1]
    rad = Unit("rad", 1.0)
    unit = {"alpha_E": rad, "turn_E": rad, "pixel": UNIT_PIXEL, "late_s": Unit("s", 1.0)}.get(
        field, UNIT_METRE
    )
    labels = tuple(str(k + 1) for k in range(q))
    return Source(name, "as stated", field, pattern, group, np.arange(q), np.ones(q), labels, unit)


def element(o: Observations, field: Field) -> Index:
    """Element of a field that acts on each sighting, (n,)."""
    if field in ("alpha_E", "rho_J", "late_s"):
        return o.image
    return o.landmark if field == "pi_J" else np.arange(o.n)


def _slope(o: Observations, model: Linearised, field: Field) -> Array:
    """d z / d field of each sighting (n, 2, d), by the first order of the measurement equation."""
    match field:
        case "alpha_E" | "turn_E":
            return -model.H
        case "rho_J":
            return model.R
        case "pi_J":
            return -model.R
        case "pixel":
            return np.broadcast_to(-np.eye(2), (o.n, 2, 2))
        case "late_s":
            return model.R @ o.v_J[..., None] - model.H @ o.omega_E[..., None]
        case "tangent":
            return np.asarray(-np.linalg.inv(model.B))


@dataclass(frozen=True)
class Effect:
    """What a source does to the residuals: draw ``group`` (n,) times ``block`` (n, 2, q), px per unit draw."""

    source: Source
    group: Index
    block: Array

    @classmethod
    def of(cls, source: Source, o: Observations, model: Linearised) -> Effect:
        j = element(o, source.field)
        return cls(source, source.group[j], _slope(o, model, source.field) @ source.gain[..., j, :, :])

    def covariance(self) -> Array:
        """Covariance of all residuals by this source, (2 n, 2 n) px^2."""
        flat = self.block.reshape(-1, self.block.shape[-1])
        same = np.repeat(self.group, 2)
        return np.asarray((flat @ flat.mT) * (same[:, None] == same[None, :]))

    def columns(self) -> Array:
        """Residuals by a unit draw of each group and coordinate, (n, 2, groups q)."""
        n, _, q = self.block.shape
        spread = np.zeros((n, 2, self.source.groups, q))
        spread[np.arange(n), :, self.group] = self.block
        return spread.reshape(n, 2, -1)

    def through(self, gain: Array) -> Array:
        """Response (3, groups, q) of an estimate ``gain (3, 2 n) z`` to a unit draw of each group and coordinate."""
        n, _, q = self.block.shape
        response = np.zeros((self.source.groups, 3, q))
        np.add.at(response, self.group, np.moveaxis(gain.reshape(3, n, 2), 1, 0) @ self.block)
        return np.moveaxis(response, 0, 1)


def state(truth: Observations, sources: Sequence[Source], model: Linearised) -> Observations:
    """The table with these sources as its stated errors.

    What an image's markers share, what a landmark's images share and what nobody shares have their own places in the
    table; an error with any other pattern goes into ``common_px``.  Raises ValueError where no source is pixel noise.
    """
    m, L, n = truth.n_images, truth.n_landmarks, truth.n
    sums = {"alpha_E": np.zeros((m, 3, 3)), "rho_J": np.zeros((m, 3, 3)), "pi_J": np.zeros((L, 3, 3))}
    pixel, common = np.zeros((n, 2, 2)), list[Source]()
    for source in sources:
        own = source.gain @ source.gain.mT
        if source.is_white and source.field in sums:
            sums[source.field] = sums[source.field] + own
        elif source.is_white and source.field == "pixel":
            pixel = pixel + own
        else:
            common.append(source)
    if not np.all(np.linalg.eigvalsh(pixel) > 0.0):
        raise ValueError("no stated source is pixel noise")
    return replace(
        truth,
        cov_attitude_E=sums["alpha_E"],
        cov_position_J=sums["rho_J"],
        cov_landmark_J=sums["pi_J"],
        **_noise(pixel),
        **common_columns(common, truth, model),
    )


def _noise(pixel: Array) -> dict[str, Any]:
    """Fields ``sigma_px`` and ``ellipse`` of the covariances (n, 2, 2) of pixels."""
    if np.allclose(pixel, pixel[:, :1, :1] * np.eye(2), rtol=1e-12, atol=0.0):
        return {"sigma_px": np.sqrt(pixel[:, 0, 0]), "ellipse": None}
    variance = 0.5 * np.trace(pixel, axis1=-2, axis2=-1)
    return {"sigma_px": np.sqrt(variance), "ellipse": pixel / variance[:, None, None]}


def common_columns(sources: Sequence[Source], o: Observations, model: Linearised) -> dict[str, Any]:
    """Fields ``common_px`` and ``common_of`` of a table in which several sightings share the errors of sources."""
    if not sources:
        return {"common_px": None, "common_of": None}
    columns = [Effect.of(source, o, model).columns() for source in sources]
    names = [
        source.name for source, block in zip(sources, columns, strict=True) for _ in range(block.shape[-1])
    ]
    return {"common_px": np.concatenate(columns, axis=-1), "common_of": tuple(names)}
