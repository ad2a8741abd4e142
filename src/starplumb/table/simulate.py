"""From truth to measurements: what the instruments would report of a scene whose geometry and mounting are known."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..physics.covariance import square_root
from .equation import predict
from .observations import Observations

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Errors:
    """Errors of one or many runs: measured = true + error, of a rotation exp(error) times it.

    ``alpha_E`` (..., m, 3) rad attitude of each image; ``rho_J`` (..., m, 3) m position of each image;
    ``pi_J`` (..., L, 3) m place of each landmark; ``pixel`` (..., n, 2) column and row of each sighting;
    ``late_s`` (..., m) s by which attitude and position of an image are read too late; ``tangent`` (..., n, 2) error of
    the look direction xy_K that the camera model gives a sighting's pixel.  None for no such error.
    """

    alpha_E: Array
    rho_J: Array
    pi_J: Array
    pixel: Array
    late_s: Array | None = None
    tangent: Array | None = None

    @classmethod
    def draw(cls, truth: Observations, rng: np.random.Generator, batch: tuple[int, ...] = ()) -> Errors:
        """Gaussian errors with the covariances the table states."""
        m, L, n = truth.n_images, truth.n_landmarks, truth.n

        def shared(covariance: Array, count: int) -> Array:
            unit = rng.standard_normal((*batch, count, 3, 1))
            return np.asarray((square_root(covariance) @ unit)[..., 0])

        return cls(
            shared(truth.cov_attitude_E, m),
            shared(truth.cov_position_J, m),
            shared(truth.cov_landmark_J, L),
            truth.sigma_px[..., None] * rng.standard_normal((*batch, n, 2)),
        )

    def only(self, source: str) -> Errors:
        """The errors of one source, a field's name, alone."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return Errors(**{n: v if n == source or v is None else np.zeros_like(v) for n, v in values.items()})


def measure(truth: Observations, C_EK_true: Array, errors: Errors) -> Observations:
    """The table the instruments would give: the true scene of ``truth`` with errors, batch axes from either.

    The marker falls where the measurement equation puts it; a line scanner's row error exposes the row at another time,
    so attitude and position are read ``row error x line period`` later (to first order in the motion).
    """
    o = truth
    xy_K = predict(C_EK_true, o.e_E) + (o.slope_K @ errors.pixel[..., None])[..., 0]
    if errors.tangent is not None:
        xy_K = xy_K + errors.tangent
    late = o.line_period_s * errors.pixel[..., 1]
    if errors.late_s is not None:
        late = late + errors.late_s[..., o.image]
    C_EJ = so3.exp(late[..., None] * o.omega_E + errors.alpha_E[..., o.image, :]) @ o.C_EJ
    r_J = o.r_J + errors.rho_J[..., o.image, :] + late[..., None] * o.v_J
    p_J = o.p_J + errors.pi_J[..., o.landmark, :]
    return replace(o.with_geometry(C_EJ=C_EJ, r_J=r_J, p_J=p_J), xy_K=xy_K)
