"""Attitude samples predicted from their neighbours.

A cubic through nodes t_j misses a smooth motion at t by ``f''''(t) / 24 prod_j (t - t_j)``, so that what a prediction
misses at a sample tells what the interpolation misses elsewhere::

    missed at t = missed at the sample * prod_j (t - t_j) / prod_j (t_k - t_j)

which is 0.14 halfway between samples of one step (for a sine of angle u between samples exactly
``(1 - 9/8 cos u/2 + 1/8 cos 3u/2) / (1 - 4/3 cos u + 1/3 cos 2u)``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ...physics.series import COINCIDENCE_NS, LONE_PAIR_S, Attitude, lagrange, seconds

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Epochs = NDArray[np.int64]

NODES = 4


@dataclass(frozen=True)
class Missed:
    """Samples k (p,) predicted from their neighbours: ``angle`` (p, 3) rad by which the prediction misses them, about
    the tracker's axes; ``noise`` (p,) its sd for white noise of 1; ``product`` (p,) of the distances to the nodes,
    s^4."""

    angle: Array
    noise: Array
    product: Array


def left_out(attitude: Attitude, k: Index) -> Missed:
    """Samples k (p,), of bursts of five or more, predicted from the four others nearest in their burst."""
    first, last = (bound[k] for bound in attitude.bursts.bounds)
    start = np.clip(k - NODES // 2, first, last - NODES)
    window = start[:, None] + np.arange(NODES + 1)
    nodes = window[window != k[:, None]].reshape(k.size, NODES)
    t_ns = attitude.t_ns
    tau, x = seconds(t_ns[nodes] - t_ns[k, None]), np.zeros(k.size)
    L, _, _ = lagrange(x, tau)
    anchor = so3.from_quaternion(attitude.q_EF[k])
    w = so3.log(so3.from_quaternion(attitude.q_EF[nodes]) @ anchor[:, None].mT)
    missed = -np.einsum("pk,pki->pi", L, w)
    return Missed(missed, np.sqrt(1.0 + np.sum(L**2, axis=-1)), np.prod(tau, axis=-1))


@dataclass(frozen=True)
class Between:
    """Epochs (q,) between samples ``left`` and ``left + 1`` of bursts of five or more, with the nodes (q, 4) they are
    interpolated from and their weights, and the product of the distances to the nodes, s^4."""

    query: Index
    left: Index
    nodes: Index
    weights: Array
    product: Array


def between(attitude: Attitude, t_ns: Epochs) -> Between:
    """Where epochs (m,) lie among the samples; those that cannot be checked are left out.

    One on a sample rests on that alone: interpolation misses nothing there, and the sample's own error is the image's.
    It can be checked where the next samples are as near as those of a pair that is a series.
    """
    right = np.clip(np.searchsorted(attitude.t_ns, t_ns), 1, attitude.t_ns.size - 1)
    apart = np.abs(attitude.t_ns[np.stack([right - 1, right])] - t_ns)
    alone = (np.min(apart, axis=0) <= COINCIDENCE_NS) & (np.max(apart, axis=0) > LONE_PAIR_S * 1e9)
    covered = np.flatnonzero(attitude.bursts.covers(t_ns) & ~alone)
    first, last = attitude.bursts.bounds
    for query, nodes in attitude.bursts.windows(t_ns[covered], NODES, attitude.name):
        if nodes.shape[1] == NODES:
            long = last[nodes[:, 0]] - first[nodes[:, 0]] >= NODES
            query, nodes = covered[query[long]], nodes[long]
            x = seconds(t_ns[query] - attitude.t_ns[nodes[:, 0]])
            tau = seconds(attitude.t_ns[nodes] - attitude.t_ns[nodes[:, :1]])
            left = np.searchsorted(attitude.t_ns, t_ns[query], side="right") - 1
            left = np.clip(left, nodes[:, 0], nodes[:, -1] - 1)
            return Between(query, left, nodes, lagrange(x, tau)[0], np.prod(x[:, None] - tau, axis=-1))
    none = np.zeros(0, dtype=np.int64)
    return Between(none, none, np.zeros((0, NODES), dtype=np.int64), np.zeros((0, NODES)), np.zeros(0))


def missed_between(attitude: Attitude, place: Between) -> Array:
    """What interpolation misses (q, 3) rad at epochs, about the tracker's axes, of a smooth motion.

    The mean over the samples before and after keeps a smooth motion, and of white noise of the samples only 6 % of its
    size; their difference keeps the noise.
    """
    before, after = (left_out(attitude, place.left + side) for side in (0, 1))
    total = before.angle / before.product[:, None] + after.angle / after.product[:, None]
    return np.asarray(0.5 * total * place.product[:, None])


def is_motion(attitude: Attitude, place: Between) -> bool:
    """Whether neighbouring samples are missed alike, as by a smooth motion, and not by turns, as with white noise.

    The mean of two neighbours has cot^2(u/2) times the power of half their difference for a sine of angle u a sample,
    and 0.11 times for white noise.
    """
    d = left_out(attitude, place.nodes.reshape(-1)).angle.reshape(*place.nodes.shape, 3)
    return bool(np.sum((d[:, 1:] + d[:, :-1]) ** 2) > 0.5 * np.sum((d[:, 1:] - d[:, :-1]) ** 2))


def without(attitude: Attitude, k: int) -> Attitude:
    """The series without sample k; where it stood no gap opens."""
    starts = tuple(start - (start > k) for start in attitude.starts)
    gap_s = None if attitude.gap_s is None else 2.0 * attitude.gap_s
    return replace(
        attitude,
        t_ns=np.delete(attitude.t_ns, k),
        q_EF=np.delete(attitude.q_EF, k, axis=0),
        gap_s=gap_s,
        starts=starts,
    )
