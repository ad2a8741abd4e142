"""The adjustment of ``adjustment_size.py`` by general solvers: SciPy's sparse least squares and Ceres.

Both get the same problem in full: no error is taken to first order, every image's six errors are unknowns, and the
derivatives are those of the equation as it stands (written out for SciPy, automatic in Ceres).  With the unknowns
``theta_E`` of the alignment, corrections to the optics and ``a, b`` of each image (unit prior)::

    s_K = C_EK^T exp(-theta) exp(-S a) (e_E + T b / range),   pixel = pp + f/pitch distorted(s_x/s_z, s_y/s_z)

The light effects stay those of the measured position: an error of metres changes them by 1e-10 rad.  A landmark's own
error is folded into the noise of its one sighting, at the start.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starplumb.estimators.wahba import Wahba
from starplumb.physics import so3
from starplumb.physics.camera import Distortion, FrameCamera
from starplumb.physics.units import ARCSEC
from starplumb.table.equation import linearise
from starplumb.table.observations import Observations
from starplumb.table.parameters import Optics

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Found:
    """A solver's answer: alignment, linearisations, CPU seconds of the solution alone, memory above the table MB, and
    the optics (8,)."""

    C_EK: Array
    passes: int
    seconds: float
    memory_mb: float = np.nan
    optics: Array | None = None


@dataclass(frozen=True)
class Problem:
    """What a general solver is given; ``unit`` (11,) is of the size of a common unknown's sigma.

    Per image ``S``, ``T`` (m, 3, 3): attitude error S a (rad) and position error in E's axes T b (m); ``first`` (m,)
    its first sighting, the table being ordered by image.
    Per sighting ``pixel`` (n, 2), ``e_E`` (n, 3), ``range_m`` (n,), ``W`` (n, 2, 2) units of sigma per pixel.
    """

    optics: Optics
    C_EK: Array
    unit: Array
    S: Array
    T: Array
    first: NDArray[np.int64]
    image: NDArray[np.int32]
    pixel: Array
    e_E: Array
    range_m: Array
    W: Array

    @classmethod
    def of(cls, o: Observations, model: Array, optics: Optics) -> Problem:
        """The table's problem from the closed form on, as :class:`Gls` starts."""
        C_EK = Wahba()(o, model).C_EK
        R = linearise(o, C_EK).R
        V = R @ o.cov_landmark_J[o.landmark] @ R.mT + (o.sigma_px**2)[:, None, None] * np.eye(2)
        first = np.searchsorted(o.image, np.arange(o.n_images))  # all sightings of a frame have one attitude
        return cls(
            optics,
            C_EK,
            np.concatenate([[0.1 * ARCSEC] * 3, 1e-5 * np.array(optics.range)]),
            np.linalg.cholesky(o.cov_attitude_E),
            o.C_EJ[first] @ np.linalg.cholesky(o.cov_position_J),
            first,
            o.image.astype(np.int32),
            optics.camera.px_from_tan(o.xy_K),
            o.e_E,
            o.range_m,
            np.linalg.inv(np.linalg.cholesky(V)),
        )

    def write(self, path: Path) -> None:
        """The file that ``ceres/adjustment.cpp`` reads and describes."""
        c, n, m = self.optics.camera, self.pixel.shape[0], self.S.shape[0]
        stated = (c.focal_length, c.pitch, *c.principal_point_px, *c.distortion.k, *c.distortion.p)
        sightings = np.concatenate(
            [self.pixel, self.e_E, self.range_m[:, None], self.W.reshape(n, 4)], axis=-1
        )
        with path.open("wb") as file:
            file.write(np.array([n, m], "<i8").tobytes())
            for part in (stated, self.C_EK.ravel(), self.unit, self.optics.range):
                file.write(np.asarray(part, "<f8").tobytes())
            np.stack([self.S, self.T], axis=1).astype("<f8").tofile(file)
            sightings.astype("<f8").tofile(file)
            self.image.astype("<i4").tofile(file)


def by_ceres(problem: Problem, program: Path, per: str, radius: float = 1e16) -> Found:
    """By the program of ``ceres/adjustment.cpp``: a cost ``per`` sighting or image, its trust region's ``radius``."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "problem"
        problem.write(path)
        run = subprocess.run([program, path, per, str(radius)], stdout=subprocess.PIPE, check=True)
    said = json.loads(run.stdout)
    if not said["converged"]:
        raise SystemExit("Ceres did not converge")
    C_EK = so3.exp(np.array(said["values"][:3])) @ problem.C_EK
    return Found(C_EK, said["passes"], said["solve_s"], said["memory_mb"], np.array(said["values"][3:]))


def by_scipy(problem: Problem, blocks: bool) -> Found:
    """By ``scipy.optimize.least_squares``: LSMR on a sparse Jacobian.

    The Jacobian's pattern is made once and its numbers are written in place.  LSMR is tight: by default it stops at a
    wrong point and calls it success.  Unknowns are scaled by their columns as ``x_scale="jac"`` does, or with
    ``blocks`` by the triangular roots of their own normal equations, 11 common unknowns and 6 an image at a time,
    which saves most of LSMR's iterations.
    """
    from scipy.optimize import least_squares

    start = time.process_time()
    full = Full.scaled(problem, blocks)
    found = least_squares(
        full.residual,
        np.zeros(full.k + 6 * full.m),
        full.jacobian,
        tr_solver="lsmr",
        tr_options={"atol": 1e-12, "btol": 1e-12, "maxiter": 3000},
        xtol=1e-15,
        ftol=1e-13,  # as Ceres: their steps, too, are judged by the cost
        gtol=1e-15,
    )
    seconds = time.process_time() - start
    if not found.success:
        raise SystemExit(f"SciPy: {found.message}")
    x = full.values(found.x)[0]
    return Found(so3.exp(x[:3]) @ problem.C_EK, found.njev, seconds, optics=x[3:])


@dataclass(frozen=True)
class Full:
    """Residuals and sparse Jacobian of the whole problem in unknowns u (11 + 6 m,).

    ``common`` (11, 11) and ``own`` (m, 6, 6) turn u into the problem's unknowns.  Rows are those of the sightings and
    of the priors; ``indices`` and ``indptr`` are the pattern of all of them.
    """

    problem: Problem
    common: Array
    own: Array
    indices: NDArray[np.int32]
    indptr: NDArray[np.int32]

    @property
    def n(self) -> int:
        return self.problem.pixel.shape[0]

    @property
    def m(self) -> int:
        return self.problem.S.shape[0]

    @property
    def k(self) -> int:
        return self.problem.unit.size

    @property
    def held(self) -> Array:
        """Prior on the optics, (8, 11)."""
        return np.eye(self.k)[3:] * (self.problem.unit[3:] / np.array(self.problem.optics.range))[:, None]

    @classmethod
    def scaled(cls, problem: Problem, blocks: bool) -> Full:
        m, k = problem.S.shape[0], problem.unit.size
        columns = np.arange(k, dtype=np.int32), k + np.arange(6 * m, dtype=np.int32).reshape(m, 6)
        every = np.concatenate(
            [np.broadcast_to(columns[0], (problem.image.size, k)), columns[1][problem.image]], axis=-1
        )
        indices = np.concatenate(
            [
                np.repeat(every, 2, axis=0).ravel(),
                np.tile(columns[0], k - 3),
                np.repeat(columns[1], 6, axis=0).ravel(),
            ]
        )
        width = np.repeat([k + 6, k, 6], [2 * problem.image.size, k - 3, 6 * m])
        indptr = np.concatenate([[0], np.cumsum(width)]).astype(np.int32)
        full = cls(problem, np.eye(k), np.broadcast_to(np.eye(6), (m, 6, 6)), indices, indptr)
        P = full.design(np.zeros(k), np.zeros((m, 6, 1)))
        G = P[..., k:]
        N, N_own = full.held.T @ full.held, np.add.reduceat(G.mT @ G, problem.first) + np.eye(6)
        N += np.tensordot(P[..., :k], P[..., :k], axes=([0, 1], [0, 1]))
        if not blocks:
            N, N_own = N * np.eye(k), N_own * np.eye(6)
        # the trust region starts at 1 and would grow by two a step: in these units it does not bind
        wide = 1e3 * np.sqrt(full.n)
        common, own = (wide * np.linalg.inv(np.linalg.cholesky(M)).mT for M in (N, N_own))
        return replace(full, common=common, own=own)

    def values(self, u: Array) -> tuple[Array, Array]:
        """Common unknowns in SI (11,) and (a, b) of the images (m, 6, 1)."""
        own = self.own @ u[self.k :].reshape(self.m, 6, 1)
        return self.problem.unit * (self.common @ u[: self.k]), own

    def _directions(self, x: Array, own: Array) -> tuple[Array, Array, Array]:
        """C_KE (m, 3, 3) from each image's measured attitude, s_E by that attitude and s_K (n, 3)."""
        p = self.problem
        C_KE = (so3.exp(x[:3]) @ p.C_EK).T @ so3.exp(-(p.S @ own[:, :3])[..., 0])
        s_E = p.e_E + (p.T @ own[:, 3:])[p.image, :, 0] / p.range_m[:, None]
        return C_KE, s_E, (C_KE[p.image] @ s_E[..., None])[..., 0]

    def residual(self, u: Array) -> Array:
        p, (x, own) = self.problem, self.values(u)
        _, _, s_K = self._directions(x, own)
        off = corrected(p.optics.camera, x[3:]).px_from_tan(s_K[:, :2] / s_K[:, 2:]) - p.pixel
        return np.concatenate([(p.W @ off[..., None]).ravel(), self.held @ (x / p.unit), own.ravel()])

    def jacobian(self, u: Array) -> Any:
        from scipy.sparse import csr_matrix

        P, k = self.design(*self.values(u)), self.k
        P[..., :k] = P[..., :k] @ self.common
        P[..., k:] = P[..., k:] @ self.own[self.problem.image]
        data = np.concatenate([P.ravel(), (self.held @ self.common).ravel(), self.own.ravel()])
        return csr_matrix((data, self.indices, self.indptr), shape=(self.indptr.size - 1, u.size))

    def design(self, x: Array, own: Array) -> Array:
        """Derivatives (n, 2, 11 + 6) of a sighting's whitened residual by the problem's unknowns.

        Of ``exp(-w - dw) = exp(-w) exp(-J(w) dw)`` a vector v turned by it changes by ``exp(-w) v x J(w) dw``.
        """
        p, k, camera = self.problem, self.k, corrected(self.problem.optics.camera, x[3:])
        C_KE, s_E, s_K = self._directions(x, own)
        h = s_K[:, :2] / s_K[:, 2:]
        h_d, slope = camera.distortion.apply(h)
        by_h = np.concatenate([np.broadcast_to(np.eye(2), (self.n, 2, 2)), -h[..., None]], axis=-1)
        by_s = camera.focal_length / camera.pitch * (p.W @ slope @ by_h) / s_K[:, 2, None, None]
        C_EK, by_s_E = so3.exp(x[:3]) @ p.C_EK, by_s @ C_KE[p.image]
        turned = (so3.left_jacobian((p.S @ own[:, :3])[..., 0]) @ p.S)[p.image]
        P = np.empty((self.n, 2, k + 6))
        P[..., :3] = by_s @ C_EK.T @ so3.skew(s_K @ C_EK.T) @ so3.left_jacobian(x[:3]) * p.unit[:3]
        P[..., 3:k] = p.W @ _by_optics(h, h_d, camera) * p.unit[3:]
        P[..., k : k + 3] = by_s_E @ so3.skew(s_E) @ turned
        P[..., k + 3 :] = by_s_E @ p.T[p.image] / p.range_m[:, None, None]
        return P


def corrected(camera: FrameCamera, x: Array) -> FrameCamera:
    """The camera with corrections (8,) to focal length, principal point, k1, k2, k3, p1, p2."""
    k, p = camera.distortion.k, camera.distortion.p
    return replace(
        camera,
        focal_length=camera.focal_length + x[0],
        principal_point_px=tuple(camera.principal_point_px + x[1:3]),
        distortion=Distortion(tuple(k + x[3:6]), tuple(p + x[6:8])),
    )


def _by_optics(h: Array, h_d: Array, camera: FrameCamera) -> Array:
    """d pixel / d (f, pp, k1, k2, k3, p1, p2) (n, 2, 8) at the ideal tangents h and the distorted ones h_d."""
    (x, y), r2 = h.T, np.sum(h * h, axis=-1)
    scale = camera.focal_length / camera.pitch
    D = np.zeros((*h.shape, 8))
    D[..., 0] = h_d / camera.pitch
    D[:, 0, 1] = D[:, 1, 2] = 1.0
    for i in range(3):
        D[..., 3 + i] = scale * h * r2[:, None] ** (i + 1)
    D[:, 0, 6] = D[:, 1, 7] = scale * 2.0 * x * y
    D[:, 1, 6], D[:, 0, 7] = scale * (r2 + 2.0 * y * y), scale * (r2 + 2.0 * x * x)
    return D
