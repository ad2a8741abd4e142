"""Several star trackers as one: their attitudes brought into E and averaged on the rotation group.

A tracker's own frame is A, its boresight along z.  Its error turns into E as ``alpha_E = C_EA alpha_A``, so that of
the average is ``sum_j W_j C_EA_j alpha_A_j`` with weights W_j that add up to the identity.  About its boresight a
tracker is 5 to 20 times worse than across it: weights by inverse variance let the others stand in there, the plain mean
does not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import so3
from .covariance import square_root
from .errors import EpochError, InputError
from .series import Attitude, seconds

Array = NDArray[np.float64]
Epochs = NDArray[np.int64]
Mask = NDArray[np.bool_]
Fusion = Literal["weighted", "mean"]

SETTLED = 4e-15
"""Step of the average, rad, below which it is found."""
MOST_STEPS = 50
"""Steps to it: 3 for trackers that agree to arc seconds, 10 for a degree, ever more beyond 20 degrees."""


@dataclass(frozen=True)
class TrackerSeries:
    """One star tracker: its ``attitude`` C_AJ, its own mounting ``C_EA`` (3, 3), taken as exact, and its noise.

    ``sigma_S`` (3,) or at the samples (n, 3), rad about the axes of S, which ``C_AS`` (3, 3) takes to its own.
    """

    name: str
    attitude: Attitude
    C_EA: Array
    sigma_S: Array
    C_AS: Array = field(default_factory=lambda: np.eye(3))

    def covers(self, t_ns: Epochs) -> Mask:
        """Whether epochs (m,) lie within its samples."""
        return self.attitude.bursts.covers(t_ns)

    def covariance_E(self, t_ns: Epochs) -> Array:
        """``C_ES sigma_S^2 C_ES^T`` (m, 3, 3) rad^2 at epochs (m,); sigmas are linear between samples."""
        covariance = covariance_at(t_ns, self.attitude.t_ns, self.sigma_S, self.C_EA @ self.C_AS)
        return np.broadcast_to(covariance, (t_ns.size, 3, 3))

    def sigma_A(self, t_ns: Epochs) -> Array:
        """Sigmas (m, 3) rad about its own axes at epochs (m,)."""
        covariance_A = covariance_at(t_ns, self.attitude.t_ns, self.sigma_S, self.C_AS)
        variance = np.diagonal(covariance_A, axis1=-2, axis2=-1)
        return np.broadcast_to(np.sqrt(variance), (t_ns.size, 3))


def covariance_at(t_ns: Epochs, samples_t_ns: Epochs, sigma_S: Array, C_AS: Array) -> Array:
    """``C_AS diag(sigma_S^2) C_AS^T`` at epochs (m,): (m, 3, 3) rad^2 of sigmas at samples (n, 3), linear between them,
    or one (3, 3) of sigmas (3,) that hold always."""
    sigma = sigma_S
    if sigma.ndim == 2:
        at, known = seconds(t_ns - samples_t_ns[0]), seconds(samples_t_ns - samples_t_ns[0])
        sigma = np.stack([np.interp(at, known, column) for column in sigma.mT], axis=-1)
    scaled = C_AS * sigma[..., None, :]
    return np.asarray(scaled @ scaled.mT)


def fusion_weights(covariance_E: Array, used: Mask, fusion: Fusion) -> Array:
    """Weights W (k, ..., 3, 3), whose sum over the k trackers is the identity, of those ``used`` (k, ...).

    ``mean``: ``W_j = I / (number used)``.  ``weighted``: ``W_j = (sum_i N_i)^-1 N_j`` with the information
    ``N = covariance_E^-1`` (k, ..., 3, 3).  Raises InputError where a weighted tracker claims to be exact.
    """
    part = used[..., None, None].astype(np.float64)
    if fusion == "mean":
        return np.asarray(part / np.sum(part, axis=0) * np.eye(3))
    variances = np.linalg.eigvalsh(covariance_E)
    if np.any(variances[..., 0] <= 1e-14 * variances[..., 2]):
        raise InputError(
            "a tracker's sigma of 0 gives it all the weight; wanted positive sigmas to weight trackers"
        )
    information = part * np.linalg.inv(covariance_E)
    return np.asarray(np.linalg.inv(np.sum(information, axis=0)) @ information)


def mean_rotation(C: Array, weights: Array, start: Array) -> Array:
    """The rotation M (..., 3, 3) with ``sum_j W_j log(C_j M^T) = 0``, of C and W (k, ..., 3, 3), sought from ``start``.

    Exact on the group: whichever of the C one starts from, and however they lie.  Raises InputError where they
    contradict each other so much that no average is found.
    """
    M = start
    step = np.full(3, np.inf)
    for _ in range(MOST_STEPS):
        step = np.sum((weights @ so3.log(C @ M.mT)[..., None])[..., 0], axis=0)
        M = so3.exp(step) @ M
        if np.all(np.abs(step) < SETTLED):
            return M
    if np.any(np.abs(step) > 1e3 * SETTLED):
        raise InputError("the star trackers contradict each other: no average of their attitudes is found")
    return M


@dataclass(frozen=True)
class FusedAttitude:
    """The attitude C_EJ by all the ``trackers`` that cover an epoch, to be used like a single :class:`Attitude`."""

    trackers: tuple[TrackerSeries, ...]
    fusion: Fusion = "weighted"

    def each(self, change: Callable[[Attitude], Attitude]) -> FusedAttitude:
        """The same with ``change`` made to the series of every tracker."""
        changed = (replace(tracker, attitude=change(tracker.attitude)) for tracker in self.trackers)
        return replace(self, trackers=tuple(changed))

    def used(self, t_ns: Epochs) -> Mask:
        """Which trackers cover epochs (m,): (k, m)."""
        return np.stack([tracker.covers(t_ns) for tracker in self.trackers])

    def at(self, t_ns: ArrayLike) -> tuple[Array, Array]:
        """C_EJ (..., 3, 3) and omega_E (..., 3) rad/s with ``d C_EJ / dt = [omega_E] C_EJ``, at epochs (...).

        ``omega_E = sum_j W_j C_EA_j omega_A_j``, to the few parts in 1e5 by which the trackers disagree.
        Raises EpochError, of the first tracker, where none covers an epoch.
        """
        t = np.asarray(t_ns, dtype=np.int64)
        epochs, back = np.unique(t.reshape(-1), return_inverse=True)
        try:
            used, C, omega = self._readings(epochs)
        except EpochError as error:
            raise EpochError(str(error), int(np.flatnonzero(back == error.row)[0])) from None
        W = self._weights(epochs, used)
        first = np.argmax(used, axis=0)
        C_EJ = mean_rotation(C, W, C[first, np.arange(epochs.size)])
        omega_E = np.sum((W @ omega[..., None])[..., 0], axis=0)
        return C_EJ[back].reshape(*t.shape, 3, 3), omega_E[back].reshape(*t.shape, 3)

    def covariance_E(self, t_ns: Epochs) -> Array:
        """``sum_j W_j P_j W_j^T`` (m, 3, 3) rad^2 of the error about E's axes at epochs (m,), P_j a tracker's own.

        Where no tracker covers an epoch, as if all did.
        """
        used = self.used(t_ns)
        used = used | ~np.any(used, axis=0)
        W = self._weights(t_ns, used)
        return np.asarray(np.sum(W @ self._covariances(t_ns) @ W.mT, axis=0))

    def root_E(self, t_ns: Epochs, roots_E: Array) -> Array:
        """Symmetric square root (m, 3, 3) rad of ``sum_j W_j L_j L_j^T W_j^T``, L_j (k, 3, 3) of further errors of the
        trackers, turned into E."""
        used = self.used(t_ns)
        used = used | ~np.any(used, axis=0)
        G = self._weights(t_ns, used) @ roots_E[:, None]
        return square_root(np.sum(G @ G.mT, axis=0))

    def residuals(self, t_ns: Epochs) -> Array:
        """``log(C_j C_EJ^T)`` (k, m, 3) rad: each tracker's reading less the average, NaN where it is not used."""
        used, C, _ = self._readings(t_ns)
        C_EJ, _ = self.at(t_ns)
        return np.where(used[..., None], so3.log(C @ C_EJ.mT), np.nan)

    def disagreement(self, t_ns: Epochs) -> Array:
        """Chi-square (m,) of the readings at epochs (m,) about their weighted average, 3 (number used - 1) degrees of
        freedom each: ``sum_j r_j^T P_j^-1 r_j``."""
        residual = np.nan_to_num(replace(self, fusion="weighted").residuals(t_ns))
        scaled = np.linalg.solve(self._covariances(t_ns), residual[..., None])[..., 0]
        return np.asarray(np.sum(residual * scaled, axis=(0, 2)))

    def _covariances(self, t_ns: Epochs) -> Array:
        return np.stack([tracker.covariance_E(t_ns) for tracker in self.trackers])

    def _weights(self, t_ns: Epochs, used: Mask) -> Array:
        return fusion_weights(self._covariances(t_ns), used, self.fusion)

    def _readings(self, t_ns: Epochs) -> tuple[Mask, Array, Array]:
        """Trackers used (k, m) at epochs (m,), their C_EJ (k, m, 3, 3) and omega_E (k, m, 3), idle where not used."""
        used = self.used(t_ns)
        alone = np.flatnonzero(~np.any(used, axis=0))
        if alone.size:
            self._refuse(t_ns, int(alone[0]))
        C = np.tile(np.eye(3), (*used.shape, 1, 1))
        omega = np.zeros((*used.shape, 3))
        for j, tracker in enumerate(self.trackers):
            rows = np.flatnonzero(used[j])
            try:
                C_AJ, omega_A = tracker.attitude.at(t_ns[rows])
            except EpochError as error:  # outside the table of Earth orientation
                raise EpochError(str(error), int(rows[error.row])) from None
            C[j, rows], omega[j, rows] = tracker.C_EA @ C_AJ, omega_A @ tracker.C_EA.mT
        return used, C, omega

    def _refuse(self, t_ns: Epochs, row: int) -> None:
        """Raise the first tracker's error, and say that the others do not cover the epoch either."""
        others = ", ".join(tracker.name for tracker in self.trackers[1:])
        also = f" (nor does any of {others} cover it)" if others else ""
        try:
            self.trackers[0].attitude.at(t_ns[row : row + 1])
        except EpochError as error:
            raise EpochError(f"{error}{also}", row) from None
