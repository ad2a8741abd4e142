"""Sampled orbit and attitude: interpolation inside bursts of samples, never beyond them and never across a gap."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import so3
from .earth import OMEGA_EARTH
from .errors import EpochError, InputError
from .orbit import velocity_fault
from .timescales import format_iso

Array = NDArray[np.float64]
Epochs = NDArray[np.int64]

COINCIDENCE_NS = 1_000
"""An epoch within this of a sample (one microsecond) is the sample's and needs no neighbour."""
GAP_FACTOR = 3.5
"""Samples farther apart than this many median spacings belong to different bursts, unless a gap is stated."""
LONE_PAIR_S = 10.0
"""Two samples farther apart, with no third to tell their rate, are no series unless the largest gap is stated."""


class Orientation(Protocol):
    """Turns Earth-fixed directions into inertial ones."""

    def C_IJ(self, t_ns: ArrayLike) -> Array: ...


@dataclass(frozen=True)
class Bursts:
    """Samples at ``t_ns`` (n,), strictly increasing, cut wherever two of them lie more than ``gap_s`` apart.

    ``gap_s`` None: 3.5 times the median spacing, and ``pair_s`` for two samples, which have none.  ``starts`` are
    samples at which a new burst begins however near the one before it lies: arcs of a file, which a manoeuvre may part.
    """

    t_ns: Epochs
    gap_s: float | None = None
    starts: tuple[int, ...] = ()
    pair_s: float = LONE_PAIR_S

    def __post_init__(self) -> None:
        if self.t_ns.size == 0:
            raise InputError("the series holds no sample, wanted at least one")
        step = np.diff(self.t_ns)
        if np.any(step <= 0):
            raise InputError(f"sample {int(np.argmax(step <= 0)) + 2} is not later than the one before it")

    @cached_property
    def limit_s(self) -> float:
        """Largest spacing inside a burst, s."""
        if self.gap_s is not None:
            return self.gap_s
        if self.t_ns.size < 3:
            return self.pair_s
        return GAP_FACTOR * float(np.median(np.diff(self.t_ns))) * 1e-9

    @cached_property
    def bounds(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """First and last sample of the burst to which each sample belongs, (n,) each."""
        n = self.t_ns.size
        gaps = np.flatnonzero(np.diff(self.t_ns) > np.rint(1e9 * self.limit_s)) + 1
        cut = np.union1d(gaps, np.array(self.starts, dtype=np.int64))
        starts, ends = np.concatenate([[0], cut]), np.concatenate([cut, [n]])
        repeats = ends - starts
        return np.repeat(starts, repeats), np.repeat(ends - 1, repeats)

    def windows(
        self, t_ns: Epochs, width: int, what: str
    ) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Groups (queries, first sample (q,) with its ``k`` samples (q, k)) of the nodes to use at epochs (m,).

        As many as ``width`` nodes of the epoch's own burst, centred on it where the burst allows.  Each group
        has one k. Raises EpochError for an epoch outside every burst, naming the nearest sample.
        """
        left, nearest, covered = self._neighbours(t_ns)
        if not np.all(covered):
            self._refuse(t_ns, nearest, int(np.argmin(covered)), what)
        first, last = self.bounds
        coincides = np.abs(self.t_ns[nearest] - t_ns) <= COINCIDENCE_NS
        anchor = np.where(coincides, nearest, left)
        k = np.minimum(width, last[anchor] - first[anchor] + 1)
        start = np.clip(anchor - (k - 1) // 2, first[anchor], last[anchor] - k + 1)
        groups = []
        for size in np.unique(k):
            queries = np.flatnonzero(k == size)
            groups.append((queries, start[queries, None] + np.arange(size)))
        return groups

    def covers(self, t_ns: Epochs) -> NDArray[np.bool_]:
        """Whether epochs (m,) lie within a burst, or on a sample."""
        return self._neighbours(t_ns)[2]

    def _neighbours(self, t_ns: Epochs) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
        """Of epochs (m,): the sample before, the nearest one, and whether the epoch is covered."""
        left = np.clip(np.searchsorted(self.t_ns, t_ns, side="right") - 1, 0, self.t_ns.size - 1)
        right = np.minimum(left + 1, self.t_ns.size - 1)
        nearest = np.where(np.abs(self.t_ns[right] - t_ns) < np.abs(t_ns - self.t_ns[left]), right, left)
        coincides = np.abs(self.t_ns[nearest] - t_ns) <= COINCIDENCE_NS
        inside = (self.t_ns[left] <= t_ns) & (t_ns <= self.t_ns[right]) & (self.bounds[1][left] >= right)
        return left, nearest, inside | coincides

    def _refuse(self, t_ns: Epochs, nearest: NDArray[np.int64], row: int, what: str) -> None:
        epoch, sample = format_iso(np.array([t_ns[row], self.t_ns[nearest[row]]]), "UTC")
        away = abs(int(t_ns[row]) - int(self.t_ns[nearest[row]])) * 1e-9
        arcs = " or of two arcs" if self.starts else ""
        between = self.t_ns[0] < t_ns[row] < self.t_ns[-1]
        place = f"in a gap of {what} (samples more than {self.limit_s:g} s apart{arcs} are not joined)"
        outside = f"outside {what} (which is never extrapolated)"
        raise EpochError(
            f"found the epoch {epoch} UTC {place if between else outside}, wanted one that its samples cover; "
            f"the nearest sample is {away:.6g} s away, at {sample} UTC",
            row,
        )


def seconds(interval_ns: Epochs) -> Array:
    """Seconds of an interval in nanoseconds."""
    return np.asarray(interval_ns * 1e-9, dtype=np.float64)


def lagrange(x: Array, nodes: Array) -> tuple[Array, Array, Array]:
    """Lagrange basis L_j(x), its derivative L_j'(x), and L_j'(x_j).  x (q,), nodes (q, k) -> (q, k) each."""
    k = nodes.shape[-1]
    d = nodes[:, :, None] - nodes[:, None, :] + np.eye(k)  # the diagonal is set to 1 to divide safely
    f = (x[:, None, None] - nodes[:, None, :]) / d  # (x - x_m) / (x_j - x_m)
    diagonal = np.arange(k)
    f[:, diagonal, diagonal] = 1.0
    basis = np.prod(f, axis=-1)
    slope = np.zeros_like(basis)
    for m in range(k):
        others = f.copy()
        others[:, :, m] = 1.0 / d[:, :, m]
        term = np.prod(others, axis=-1)
        term[:, m] = 0.0
        slope += term
    inverse = 1.0 / d
    inverse[:, diagonal, diagonal] = 0.0
    return basis, slope, np.sum(inverse, axis=-1)


def _hermite(x: Array, nodes: Array) -> tuple[Array, Array, Array, Array]:
    """Hermite weights of values and slopes, for the value and for the derivative: H, K, H', K' (q, k)."""
    L, dL, own = lagrange(x, nodes)
    h = x[:, None] - nodes
    bracket = 1.0 - 2.0 * h * own
    H, K = bracket * L**2, h * L**2
    dH = -2.0 * own * L**2 + 2.0 * bracket * L * dL
    dK = L**2 + 2.0 * h * L * dL
    return H, K, dH, dK


@dataclass(frozen=True)
class Ephemeris:
    """Positions of the camera in J, m, and, where known, velocities relative to the turning Earth, m/s.

    Shapes: ``t_ns`` (n,), ``r_J`` and ``v_J`` (n, 3).  Hermite interpolation on up to 4 samples where velocities are
    given (degree 7), else Lagrange on up to 8 positions, at least 4: an orbit is never joined by straight lines.
    """

    t_ns: Epochs
    r_J: Array
    v_J: Array | None = None
    gap_s: float | None = None
    name: str = "the ephemeris"
    """Its name in messages: the user's file."""
    starts: tuple[int, ...] = ()
    """Samples at which a new arc begins; nothing is interpolated across its beginning."""

    def __post_init__(self) -> None:
        if self.v_J is None:
            return
        if (fault := velocity_fault(self.t_ns, self.r_J, self.v_J, self.bursts.bounds[1])) is not None:
            raise InputError(fault)

    @cached_property
    def bursts(self) -> Bursts:
        # velocities tell what lies between two samples
        pair_s = LONE_PAIR_S if self.v_J is None else float("inf")
        return Bursts(self.t_ns, self.gap_s, self.starts, pair_s)

    def at(self, t_ns: ArrayLike, velocity: bool = True) -> tuple[Array, Array]:
        """Position r_J and velocity v_J at epochs of any shape (...) -> (..., 3) each.

        With ``velocity`` False an epoch on a lone sample is accepted though nothing gives its velocity, which
        then is 0. Raises EpochError outside the samples, in a gap, or where a burst is too short to
        interpolate.
        """
        t = np.asarray(t_ns, dtype=np.int64)
        flat = t.reshape(-1)
        r, v = np.empty((flat.size, 3)), np.empty((flat.size, 3))
        width = 8 if self.v_J is None else 4
        for queries, nodes in self.bursts.windows(flat, width, self.name):
            if self.v_J is None and nodes.shape[1] < 4:
                r[queries], v[queries] = self._lone(flat[queries], nodes, queries, velocity)
            else:
                r[queries], v[queries] = self._interpolate(flat[queries], nodes)
        return r.reshape(*t.shape, 3), v.reshape(*t.shape, 3)

    def _lone(
        self, t_ns: Epochs, nodes: NDArray[np.int64], queries: NDArray[np.int64], velocity: bool
    ) -> tuple[Array, Array]:
        """Positions of epochs that fall on samples of a burst too short to interpolate without velocities."""
        away = np.abs(self.t_ns[nodes] - t_ns[:, None])
        nearest = np.argmin(away, axis=1)
        lacking = velocity | (np.min(away, axis=1) > COINCIDENCE_NS)
        if np.any(lacking):
            first, k = int(np.argmax(lacking)), nodes.shape[1]
            raise EpochError(
                f"found only {k} sample{'s' if k > 1 else ''} and no velocities in {self.name} around "
                f"{format_iso(t_ns[first : first + 1], 'UTC')[0]} UTC, wanted velocities "
                "(vx_m_s, vy_m_s, vz_m_s) or at least 4 positions in a row",
                int(queries[first]),
            )
        chosen = np.take_along_axis(nodes, nearest[:, None], axis=1)[:, 0]
        return self.r_J[chosen], np.zeros((t_ns.size, 3))

    def _interpolate(self, t_ns: Epochs, nodes: NDArray[np.int64]) -> tuple[Array, Array]:
        origin = self.t_ns[nodes[:, :1]]
        tau = seconds(self.t_ns[nodes] - origin)
        x = seconds(t_ns - origin[:, 0])
        r = self.r_J[nodes]
        if self.v_J is not None:
            H, K, dH, dK = _hermite(x, tau)
            v = self.v_J[nodes]
            return (
                np.einsum("qk,qki->qi", H, r) + np.einsum("qk,qki->qi", K, v),
                np.einsum("qk,qki->qi", dH, r) + np.einsum("qk,qki->qi", dK, v),
            )
        L, dL, _ = lagrange(x, tau)
        return np.einsum("qk,qki->qi", L, r), np.einsum("qk,qki->qi", dL, r)


@dataclass(frozen=True)
class Attitude:
    """Samples of C_EF: the star tracker's frame E from F, inertial (``GCRF``) or Earth-fixed (``ITRF``).

    Shapes: ``t_ns`` (n,), ``q_EF`` (n, 4) Hamilton quaternions (x, y, z, w) that rotate v_F into v_E; their
    signs do not matter.  Between samples the rotation away from one of them is a cubic in the tangent space
    (on up to 4 samples of the burst; two samples give the geodesic).
    """

    t_ns: Epochs
    q_EF: Array
    frame: Literal["GCRF", "ITRF"]
    orientation: Orientation | None = None
    gap_s: float | None = None
    name: str = "the attitude"
    """Its name in messages: the user's file."""
    starts: tuple[int, ...] = ()
    """Samples at which a new arc begins; nothing is interpolated across its beginning."""
    quaternion_step: float = 0.0
    """Step of the last digit of the quaternions in the file, 0 where it does not matter."""

    def __post_init__(self) -> None:
        if self.frame == "GCRF" and self.orientation is None:
            raise ValueError("an inertial attitude needs the orientation of the Earth")

    @cached_property
    def bursts(self) -> Bursts:
        return Bursts(self.t_ns, self.gap_s, self.starts)

    def at(self, t_ns: ArrayLike) -> tuple[Array, Array]:
        """C_EJ (..., 3, 3) and omega_E (..., 3) rad/s with ``d C_EJ / dt = [omega_E] C_EJ``, at epochs (...).

        Raises EpochError outside the samples, in a gap, or outside the table of Earth orientation.
        """
        t = np.asarray(t_ns, dtype=np.int64)
        epochs, back = np.unique(t.reshape(-1), return_inverse=True)
        C, omega = np.empty((epochs.size, 3, 3)), np.empty((epochs.size, 3))
        try:
            for queries, nodes in self.bursts.windows(epochs, 4, self.name):
                C[queries], omega[queries] = self._interpolate(epochs[queries], nodes)
            C_EJ, omega_E = self._earth_fixed(epochs, C, omega)
        except EpochError as error:
            raise EpochError(str(error), int(np.flatnonzero(back == error.row)[0])) from None
        return C_EJ[back].reshape(*t.shape, 3, 3), omega_E[back].reshape(*t.shape, 3)

    def weights(self, t_ns: Epochs) -> tuple[NDArray[np.int64], Array]:
        """Samples (n, 4) from which epochs (n,) are interpolated and their weights (n, 4), 0 where fewer are used.

        To first order the error at an epoch is the weighted sum of the errors of the samples.
        """
        samples, weights = np.zeros((t_ns.size, 4), dtype=np.int64), np.zeros((t_ns.size, 4))
        for queries, nodes in self.bursts.windows(t_ns, 4, self.name):
            origin = self.t_ns[nodes[:, :1]]
            tau, x = seconds(self.t_ns[nodes] - origin), seconds(t_ns[queries] - origin[:, 0])
            k = nodes.shape[1]
            samples[queries, :k], weights[queries, :k] = nodes, lagrange(x, tau)[0]
        return samples, weights

    def _interpolate(self, t_ns: Epochs, nodes: NDArray[np.int64]) -> tuple[Array, Array]:
        anchor = nodes[:, (nodes.shape[1] - 1) // 2]
        C_anchor = so3.from_quaternion(self.q_EF[anchor])
        w = so3.log(so3.from_quaternion(self.q_EF[nodes]) @ C_anchor[:, None].mT)
        tau = seconds(self.t_ns[nodes] - self.t_ns[anchor][:, None])
        x = seconds(t_ns - self.t_ns[anchor])
        L, dL, _ = lagrange(x, tau)
        turn = np.einsum("qk,qki->qi", L, w)
        rate = np.einsum("qk,qki->qi", dL, w)
        omega = np.einsum("qij,qj->qi", so3.left_jacobian(turn), rate)
        return so3.exp(turn) @ C_anchor, omega

    def _earth_fixed(self, t_ns: Epochs, C_EF: Array, omega_E: Array) -> tuple[Array, Array]:
        if self.orientation is None:
            return C_EF, omega_E
        C_EJ = C_EF @ self.orientation.C_IJ(t_ns)
        return C_EJ, omega_E + OMEGA_EARTH * C_EJ[..., :, 2]
