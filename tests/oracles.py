"""Slow, plain, independent computations that the fast code is held against.

Nothing here calls the package's own rotations, model or solver: rotations are SciPy's, derivatives are differences,
and the covariance of all observations is one dense matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import erfa
import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

C_LIGHT = 299792458.0
OMEGA = 7.292115e-5


def seen_direction(p, r, v, corrections):
    """Unit vector to a marker p from a camera at r with Earth-relative velocity v: light time and aberration."""
    if corrections.light_time:
        delay = np.linalg.norm(p - r) / C_LIGHT
        p = Rotation.from_rotvec([0, 0, -OMEGA * delay]).apply(p)
    e = (p - r) / np.linalg.norm(p - r)
    if corrections.aberration:
        b = (v + np.cross([0, 0, OMEGA], r)) / C_LIGHT
        e = erfa.ab(e, b, 1e20, np.sqrt(1 - b @ b))
    return e


@dataclass
class Sighting:
    """One marker in one image: where it should be, as a function of every error."""

    C_EJ: np.ndarray
    omega_E: np.ndarray
    r: np.ndarray
    v: np.ndarray
    p: np.ndarray
    xy: np.ndarray
    slope: np.ndarray
    line_period: float
    corrections: object

    def pixel(self, C_EK, alpha=(0, 0, 0), rho=(0, 0, 0), pi=(0, 0, 0)):
        """Offset (column, row) of the predicted from the measured pixel if the measured attitude were turned by alpha,
        the measured position moved by rho and the survey by pi.  The row is searched for where rows are epochs."""
        offset = np.zeros(2)
        for _ in range(1 if self.line_period == 0 else 4):
            late = offset[1] * self.line_period
            C = Rotation.from_rotvec(late * self.omega_E) * Rotation.from_matrix(self.C_EJ)
            C = Rotation.from_rotvec(alpha) * C
            e = seen_direction(self.p + pi, self.r + rho + late * self.v, self.v, self.corrections)
            s = C_EK.T @ C.apply(e)
            tangent = s[:2] / s[2] - self.xy - self.slope @ offset
            if self.line_period == 0:
                return np.linalg.solve(self.slope, tangent)
            offset = offset + np.linalg.solve(self._motion(C_EK, C, e), tangent)
        return offset

    def _motion(self, C_EK, C, e):
        """d (line - scene) / d (column, row), rough: it only steers the search."""
        distance = np.linalg.norm(self.p - self.r)
        drift = (-(self.v - e * (e @ self.v)) / distance) * self.line_period
        turn = np.cross(self.omega_E, C.apply(e)) * self.line_period
        rate = C_EK.T @ (C.apply(drift) + turn)
        s = C_EK.T @ C.apply(e)
        matrix = self.slope.copy()
        matrix[:, 1] -= (rate[:2] - s[:2] / s[2] * rate[2]) / s[2]
        return matrix


def sightings(o):
    return [
        Sighting(
            o.C_EJ[j],
            o.omega_E[j],
            o.r_J[j],
            o.v_J[j],
            o.p_J[j],
            o.xy_K[j],
            o.slope_K[j],
            o.line_period_s[j],
            o.corrections,
        )
        for j in range(o.n)
    ]


def residual(o, C_EK):
    """Predicted minus measured pixels of all sightings, (2 n,)."""
    return np.concatenate([s.pixel(C_EK) for s in sightings(o)])


def differences(function, steps):
    """Derivative (outputs, inputs) of a function of one vector at zero, by central differences."""
    columns = []
    for i, h in enumerate(steps):
        e = np.zeros(len(steps))
        e[i] = h
        columns.append((function(e) - function(-e)) / (2 * h))
    return np.stack(columns, axis=-1)


def turned(C_EK, d):
    return Rotation.from_rotvec(d).as_matrix() @ C_EK


@dataclass
class Sensitivities:
    """Pixels (2 n, .) per radian or metre of the mounting's error, of image errors and of marker errors."""

    mounting: np.ndarray
    attitude: np.ndarray
    position: np.ndarray
    marker: np.ndarray


def sensitivities(o, C_EK):
    rad, metre = [1e-5] * 3, [5.0] * 3
    out = Sensitivities(
        *(np.zeros((2 * o.n, width)) for width in (3, 3 * o.n_images, 3 * o.n_images, 3 * o.n_landmarks))
    )
    for j, s in enumerate(sightings(o)):
        rows, i, k = slice(2 * j, 2 * j + 2), 3 * o.image[j], 3 * o.landmark[j]
        out.mounting[rows] = differences(lambda d, s=s: s.pixel(turned(C_EK, d)), rad)
        out.attitude[rows, i : i + 3] = differences(lambda d, s=s: s.pixel(C_EK, alpha=d), rad)
        out.position[rows, i : i + 3] = differences(lambda d, s=s: s.pixel(C_EK, rho=d), metre)
        out.marker[rows, k : k + 3] = differences(lambda d, s=s: s.pixel(C_EK, pi=d), metre)
    return out


def noise_of_pixels(o):
    """Dense (2 n, 2 n) covariance of the noise of the pixels."""
    if o.ellipse is None:
        return np.diag(np.repeat(o.sigma_px**2, 2))
    return block_diag(*(s**2 * shape for s, shape in zip(o.sigma_px, o.ellipse, strict=True)))


def covariance_of_observations(o, sens):
    """Dense (2 n, 2 n) covariance of all pixels: noise plus every shared error."""
    V = noise_of_pixels(o)
    for J, blocks in (
        (sens.attitude, o.cov_attitude_E),
        (sens.position, o.cov_position_J),
        (sens.marker, o.cov_landmark_J),
    ):
        V = V + J @ block_diag(*blocks) @ J.T
    return V


def cramer_rao(o, C_EK):
    """Smallest covariance (3, 3) an unbiased estimate of the mounting can have, rad^2 about E's axes."""
    sens = sensitivities(o, C_EK)
    H = sens.mounting
    information = H.T @ cho_solve(cho_factor(covariance_of_observations(o, sens)), H)
    if o.prior_E is not None:
        information = information + np.linalg.inv(o.prior_E)
    return np.linalg.inv(information)


def dense_gls(o, C_EK_start):
    """Mounting and chi-square by SciPy's least_squares on residuals whitened by the dense covariance."""
    C, chi2 = C_EK_start, np.nan
    for _ in range(2):  # the covariance once more at the solution
        L = cholesky(covariance_of_observations(o, sensitivities(o, C)), lower=True)

        def whitened(d, L=L, C=C):
            return solve_triangular(L, residual(o, turned(C, d * 1e-5)), lower=True)

        found = least_squares(whitened, np.zeros(3), method="lm", diff_step=1e-2, xtol=1e-12, ftol=1e-14)
        C, chi2 = turned(C, found.x * 1e-5), 2 * found.cost
    return C, chi2


def joint_adjustment(o, C_EK_start):
    """Mounting, image errors and marker errors estimated together, nothing linearised: (C_EK, alpha, rho, pi, chi2)."""
    m, L = o.n_images, o.n_landmarks
    seen = sightings(o)
    stated = np.concatenate([o.cov_attitude_E, o.cov_position_J])
    scale = np.sqrt(np.diagonal(stated, axis1=-2, axis2=-1)).ravel()
    landmark_roots = [np.linalg.cholesky(c) for c in o.cov_landmark_J]

    def unpack(y):
        shared = y[3 : 3 + 6 * m] * scale
        alpha, rho = shared[: 3 * m].reshape(m, 3), shared[3 * m :].reshape(m, 3)
        pi = np.stack(
            [root @ part for root, part in zip(landmark_roots, y[3 + 6 * m :].reshape(L, 3), strict=True)]
        )
        return turned(C_EK_start, y[:3] * 1e-5), alpha, rho, pi

    def whitened(y):
        C, alpha, rho, pi = unpack(y)
        z = [
            s.pixel(C, -alpha[i], -rho[i], -pi[k]) / sigma
            for s, i, k, sigma in zip(seen, o.image, o.landmark, o.sigma_px, strict=True)
        ]
        return np.concatenate([*z, y[3:]])

    found = least_squares(
        whitened, np.zeros(3 + 6 * m + 3 * L), method="lm", diff_step=1e-2, xtol=1e-10, ftol=1e-14
    )
    return (*unpack(found.x), 2 * found.cost)
