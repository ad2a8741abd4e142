"""The table that every estimator reads: what was measured, in which geometry, and who shares which error."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ..physics.covariance import pixel_covariance, pixel_root
from ..physics.light import Corrections, apparent_direction
from .cameras.known import RigKnown

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Observations:
    """n sightings of markers in m images of L landmarks; any leading batch axes, broadcast against one another.

    Per sighting:

    =============== =============== ================================================================================
    image           (n,)            index of its image (its tracker error and position error are that image's)
    landmark        (n,)            index of its landmark (its place error is that landmark's)
    xy_K            (..., n, 2)     measured tangents (x/z, y/z) of the look direction
    slope_K         (..., n, 2, 2)  d xy_K / d (column, row) of the camera, rad per pixel
    line_period_s   (n,)            duration of a row, s; zero for a frame camera
    C_EJ            (..., n, 3, 3)  measured attitude
    omega_E         (..., n, 3)     its rate, rad/s: d C_EJ / dt = [omega_E] C_EJ
    r_J, v_J        (..., n, 3)     measured position, m, and velocity relative to the turning Earth, m/s
    p_J             (..., n, 3)     surveyed marker, m
    e_E             (..., n, 3)     apparent direction of the marker by the measured attitude, orbit and survey
    row_rate_E      (..., n, 3)     d e_E / d row, from the motion during the scan
    range_m         (..., n)        distance from camera to marker
    sigma_px        (..., n)        standard deviation of column and of row (root mean square of the two), pixels
    ellipse         (..., n, 2, 2)  covariance of column and row over sigma_px^2; None: a circle, the identity
    weight          (..., n)        1, or 0 for a marker that was not seen (its numbers are finite, but of no
                                    consequence), so that every batch is rectangular
    =============== =============== ================================================================================

    Shared errors: ``cov_attitude_E`` (..., m, 3, 3) rad^2 about E's axes, ``cov_position_J`` (..., m, 3, 3) m^2,
    ``cov_landmark_J`` (..., L, 3, 3) m^2; ``common_px`` (..., n, 2, p), px, the residual by one sigma of each of p
    errors that any other set of sightings has in common (a drift, a pass, the optics), None for none; ``common_of``
    (p,) names the source of each, None where that is not known.

    Of several cameras ``camera`` (n,) says which took each sighting, and ``C_KC`` (..., k, 3, 3) takes coordinates from
    the frame C of each, in which its tangents are, to that of the first, K; None for one camera.  ``rig_known`` is what
    was known of all their mountings, in place of ``prior_E``, which is then the first one's part of it.

    ``corrections`` are those in ``e_E``.  ``prior_E`` (3, 3) rad^2 is what was known of the model mounting's error
    ``theta_E``, None for nothing.  ``epoch_s`` (m,) is each image's time after the first one listed, s, None where
    not known.
    """

    image: Index
    landmark: Index
    xy_K: Array
    slope_K: Array
    line_period_s: Array
    C_EJ: Array
    omega_E: Array
    r_J: Array
    v_J: Array
    p_J: Array
    e_E: Array
    row_rate_E: Array
    range_m: Array
    sigma_px: Array
    weight: Array
    cov_attitude_E: Array
    cov_position_J: Array
    cov_landmark_J: Array
    corrections: Corrections
    prior_E: Array | None = None
    epoch_s: Array | None = None
    common_px: Array | None = None
    common_of: tuple[str, ...] | None = None
    ellipse: Array | None = None
    camera: Index | None = None
    C_KC: Array | None = None
    rig_known: RigKnown | None = None

    def __post_init__(self) -> None:
        n = self.image.size
        if n and (self.image.max() >= self.n_images or self.landmark.max() >= self.n_landmarks):
            raise ValueError("an image or landmark index points past the covariances given for them")
        for name, tail in TAILS.items():
            shape = getattr(self, name).shape
            if shape[len(shape) - len(tail) - 1 :] != (n, *tail):
                raise ValueError(f"{name} has shape {shape}, wanted (..., {', '.join(map(str, (n, *tail)))})")

    @property
    def n(self) -> int:
        return int(self.image.size)

    @property
    def n_images(self) -> int:
        return int(self.cov_attitude_E.shape[-3])

    @property
    def n_landmarks(self) -> int:
        return int(self.cov_landmark_J.shape[-3])

    @property
    def batch(self) -> tuple[int, ...]:
        """Leading axes of the measured table."""
        return np.broadcast_shapes(self.xy_K.shape[:-2], self.e_E.shape[:-2], self.weight.shape[:-1])

    @property
    def noise_px(self) -> Array:
        """Covariance (..., n, 2, 2) px^2 of the noise of column and row."""
        return pixel_covariance(self.sigma_px, self.ellipse)

    @property
    def noise_root_px(self) -> Array:
        """Lower triangular root (..., n, 2, 2) px of that."""
        return pixel_root(self.sigma_px, self.ellipse)

    @property
    def e_K(self) -> Array:
        """Measured look directions as unit vectors (..., n, 3)."""
        e = np.concatenate([self.xy_K, np.ones((*self.xy_K.shape[:-1], 1))], axis=-1)
        e = np.asarray(e / np.linalg.norm(e, axis=-1, keepdims=True))
        return e if self.C_KC is None else (self.C_KC[..., self.camera, :, :] @ e[..., None])[..., 0]

    def mountings(self, C_EK: Array) -> Array:
        """C_EC of each sighting's camera (..., n, 3, 3) by the first one's mounting C_EK (..., 3, 3); of one camera
        (..., 1, 3, 3)."""
        C = C_EK[..., None, :, :]
        return C if self.C_KC is None else C @ self.C_KC[..., self.camera, :, :]

    def with_geometry(self, **changes: Any) -> Observations:
        """The same sightings with other measured geometry (C_EJ, r_J, p_J, corrections...), directions recomputed."""
        changed = replace(self, **changes)
        o = changed
        directions = sight(o.p_J, o.r_J, o.v_J, o.C_EJ, o.omega_E, o.line_period_s, o.corrections)
        return replace(changed, **cast("Any", directions))

    def select(self, keep: NDArray[np.bool_] | Index) -> Observations:
        """The sightings (n,) kept, with all images and landmarks as they were."""
        chosen: dict[str, Any] = {"image": self.image[keep], "landmark": self.landmark[keep]}
        for name, tail in TAILS.items():
            axis = -1 - len(tail)
            indices = np.flatnonzero(keep) if np.asarray(keep).dtype == bool else keep
            chosen[name] = np.take(getattr(self, name), indices, axis=axis)
        for name in MAY_LACK:
            if getattr(self, name) is not None:
                chosen[name] = getattr(self, name)[..., keep, :, :]
        if self.camera is not None:
            chosen["camera"] = self.camera[keep]
        return replace(self, **chosen)

    def run(self, index: tuple[int, ...] | tuple[Index]) -> Observations:
        """One run of a batch: the table at ``index`` into :attr:`batch`, without batch axes; of one batch axis also
        several runs (r,)."""
        chosen: dict[str, Any] = {}
        shared = dict.fromkeys(("cov_attitude_E", "cov_position_J", "cov_landmark_J", "C_KC", *MAY_LACK), 3)
        for name, own_axes in ({name: 1 + len(tail) for name, tail in TAILS.items()} | shared).items():
            values = getattr(self, name)
            if values is None:
                continue
            batch = values.shape[: values.ndim - own_axes]
            own = index[len(index) - len(batch) :]
            chosen[name] = values[tuple(i if size > 1 else 0 for i, size in zip(own, batch, strict=True))]
        return replace(self, **chosen)


def sight(
    p_J: Array,
    r_J: Array,
    v_J: Array,
    C_EJ: Array,
    omega_E: Array,
    line_period_s: Array,
    corrections: Corrections,
) -> dict[str, Any]:
    """Fields ``e_E``, ``row_rate_E``, ``range_m`` of sightings of markers p_J from stations (r_J, v_J, C_EJ, omega_E).

    ``d e_E/dt = omega_E x e_E + C_EJ d e_J/dt`` with ``d e_J/dt = -(v_J - e_J (e_J . v_J)) / range``; the change of the
    light effects during a row is 1e-5 of that and left out.
    """
    e_J, range_m = apparent_direction(p_J, r_J, v_J, corrections)
    e_E = (C_EJ @ e_J[..., None])[..., 0]
    if not np.any(line_period_s):  # a frame has no rows in time
        return {"e_E": e_E, "row_rate_E": np.zeros((*line_period_s.shape, 3)), "range_m": range_m}
    drift_J = -(v_J - e_J * np.sum(e_J * v_J, axis=-1, keepdims=True)) / range_m[..., None]
    rate = np.cross(omega_E, e_E) + (C_EJ @ drift_J[..., None])[..., 0]
    return {"e_E": e_E, "row_rate_E": line_period_s[..., None] * rate, "range_m": range_m}


def first_of_image(o: Observations, values: Array) -> Array:
    """Values (n, ...) of the first sighting of each image, (m, ...); 0 for an image without any."""
    out = np.zeros((o.n_images, *values.shape[1:]))
    out[o.image[::-1]] = values[::-1]
    return out


TAILS: dict[str, tuple[int, ...]] = {
    "xy_K": (2,),
    "slope_K": (2, 2),
    "line_period_s": (),
    "C_EJ": (3, 3),
    "omega_E": (3,),
    "r_J": (3,),
    "v_J": (3,),
    "p_J": (3,),
    "e_E": (3,),
    "row_rate_E": (3,),
    "range_m": (),
    "sigma_px": (),
    "weight": (),
}
"""Fields with one entry a sighting, and their axes behind it."""
PER_SIGHTING = tuple(TAILS)
MAY_LACK = ("common_px", "ellipse")
"""Fields (..., n, 2, w) that a table may be without."""
