"""The recursive estimator that (32) of Lebedev and Tkachenko (2012) leaves open: a Kalman filter over the
images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..physics.covariance import square_root
from ..physics.errors import InputError
from ..solve.adjustment import Adjustment, squares_by_image
from ..solve.chunks import repeated_landmarks
from ..table.equation import Linearised, linearise
from ..table.observations import Observations
from .protocol import AlignmentEstimate
from .start import Start, closed_form
from .usable import determined, settled, status_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]

ANY_ROTATION = np.pi
"""Sigma, rad, of a mounting of which nothing is known: no rotation is larger."""
ABSURD = 100.0
"""Chi-square per degree of freedom from which one pass, of which nothing tells whether it has settled, has not."""
LOCAL_STEPS = 3
"""Linearisations of an image as it comes in: from 1 deg off the third is at rounding."""
AT_ONCE = 40_000
"""Sightings times unknowns whose normal equations are formed at once: their design fits the processor's cache."""


@dataclass(frozen=True)
class State:
    """What is known after some images.

    The mounting ``C_EK`` (..., 3, 3); the errors ``u`` (..., 3 q + p) that images share, in units of their
    stated sigma: of the q landmarks seen more than once, and the p of ``common_px``; the joint
    ``information`` (..., k, k), k = 3 + 3 q + p, of (small rotation about E, u).
    """

    C_EK: Array
    u: Array
    information: Array

    @property
    def covariance_E(self) -> Array:
        return np.asarray(np.linalg.inv(self.information)[..., :3, :3])


@dataclass(frozen=True)
class Sequential:
    """Multiplicative Kalman filter of a constant or slowly drifting mounting, image after image.

    (32), ``x' = A(t) x``, ``y = H(t) x``, gives no A and no H; here x is the small rotation of the mounting
    about E with ``A = 0`` and white process noise of density Q = ``drift**2`` (rad^2/s about E's axes), H
    that of the measurement equation. Between images the covariance grows, at an image the information does,
    in information form so that a prior is not needed::

        P <- P + Q dt,   L = P^-1 <- L + H^T V^-1 H,   x = -L^-1 H^T V^-1 z,   C_EK <- exp(x) C_EK

    V holds what an image's markers share (attitude, position), by the adjustment of
    :mod:`starplumb.solve.adjustment`. A landmark seen in more than one image carries its place error from one to
    the next, as do the errors ``common_px``: they are part of the state, so that the filter of a constant
    mounting is :class:`Gls` whatever the campaign (to 1e-6 of a sigma after two passes). Its cost grows with
    the cube of their number.

    ``passes``: the first runs as in flight, each image linearised, thrice, at what is known with it;
    another runs again with all images linearised at the last answer.  Of several, the first has them linearised at
    what a run about the closed form says, unless ``start`` is ``"model"``.  ``prior_sigma`` (rad about E) of the
    model mounting, by default the table's ``prior_E``, or none.  Images come in the order of ``epoch_s``,
    which a drift needs, else of their index.

    An answer that the last of several passes still moves by more than its sigma has not converged.

    Sign and frame are ours throughout. The estimate is the mounting at the last image.
    """

    drift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    prior_sigma: tuple[float, float, float] | None = None
    passes: int = 2
    start: Start = "closed-form"

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        o = observations
        if self.passes < 1:
            raise InputError(f"passes: found {self.passes}, wanted 1 or more")
        batch = np.broadcast_shapes(o.batch, C_EK.shape[:-2])
        C_EK = np.broadcast_to(C_EK, (*batch, 3, 3))
        moved = np.zeros((*batch, 3))
        elsewhere = self.start == "closed-form" and self.passes > 1
        reference = np.broadcast_to(closed_form(o, C_EK), C_EK.shape) if elsewhere else None
        for _ in range(self.passes + elsewhere):
            state, chi2 = self._start(o, C_EK), np.zeros(batch)
            for after, cost in self._images(o, state, reference):
                state, chi2 = after, chi2 + cost
            moved = np.zeros((*batch, 3)) if reference is None else so3.log(state.C_EK @ reference.mT)
            reference = state.C_EK
        P = state.covariance_E
        known = determined(P)
        seen = np.broadcast_to(np.sum(o.weight > 0.0, axis=-1), batch)
        dof = 2 * seen - (3 if self._prior(o) is None else 0)
        converged = settled(moved, P) if self.passes > 1 else chi2 < ABSURD * np.maximum(dof, 1)
        status = status_of(o, state.C_EK, determined=known, converged=converged, chi2=chi2)
        P = np.where(known[..., None, None], P, np.inf)
        notes = ("image after image; the same as gls while the mounting does not drift",)
        return AlignmentEstimate(state.C_EK, P, status, np.full(batch, self.passes), chi2, dof, notes=notes)

    def track(self, observations: Observations, C_EK: Array) -> Iterator[State]:
        """The state after each image in time order, as in flight (one pass)."""
        batch = np.broadcast_shapes(observations.batch, C_EK.shape[:-2])
        start = self._start(observations, np.broadcast_to(C_EK, (*batch, 3, 3)))
        return (state for state, _ in self._images(observations, start, None))

    def _prior(self, o: Observations) -> Array | None:
        return o.prior_E if self.prior_sigma is None else np.diag(np.square(self.prior_sigma))

    def _start(self, o: Observations, C_EK: Array) -> State:
        """Before the first image."""
        prior = self._prior(o)
        carried = 3 * repeated_landmarks(o).size + (0 if o.common_px is None else o.common_px.shape[-1])
        information = np.eye(3 + carried)
        information[:3, :3] = np.eye(3) / ANY_ROTATION**2 if prior is None else np.linalg.inv(prior)
        batch = C_EK.shape[:-2]
        return State(
            C_EK, np.zeros((*batch, carried)), np.broadcast_to(information, (*batch, *information.shape))
        )

    def _images(
        self, o: Observations, state: State, reference: Array | None
    ) -> Iterator[tuple[State, Array]]:
        """States after each image and what the image adds to chi-square, linearised at the reference, or without one
        where the mounting is by what is known so far; images that add up to one state come as one."""
        if any(self.drift) and o.epoch_s is None:
            raise InputError(
                "sequential: found a drift but no epoch_s in the table, wanted the epochs of the images"
            )
        epoch_s = np.arange(o.n_images, dtype=np.float64) if o.epoch_s is None else o.epoch_s
        table, last_s = _Table.of(o), None
        order = np.argsort(epoch_s, kind="stable")
        order = order[[table.rows[image].size > 0 for image in order]]
        ahead = None if reference is None else table.squares(order, reference)
        if ahead is not None and reference is not None and order.size and not any(self.drift):
            # nothing is forgotten between images: their information adds
            yield _update(reduce(np.add, ahead), state, reference)
            return
        for image in order:
            if last_s is not None:
                state = self._predict(state, epoch_s[image] - last_s)
            last_s = epoch_s[image]
            if ahead is not None and reference is not None:
                state, cost = _update(next(ahead), state, reference)
            else:
                before, C_lin = state, state.C_EK
                for _ in range(LOCAL_STEPS):
                    state, cost = _update(next(table.squares(image[None], C_lin)), before, C_lin)
                    C_lin = state.C_EK
            yield state, cost

    def _predict(self, state: State, dt_s: float) -> State:
        """``P <- P + Q dt`` as ``L <- L (E + Q dt L)^-1``, which an L without inverse survives."""
        if not any(self.drift):
            return state
        Q = np.zeros(state.information.shape[-1])
        Q[:3] = np.square(self.drift) * dt_s
        L = state.information
        grown = np.linalg.solve(np.eye(Q.size) + L * Q, L)  # (E + L Q)^-1 L = L (E + Q L)^-1
        return replace(state, information=0.5 * (grown + grown.mT))


@dataclass(frozen=True)
class _Table:
    """A table with what images share as unknowns: ``own``, in which each sighting has a landmark of its own, without
    error where another sighting shares it; ``place`` (n,) of that in the state, -1 for none, and the root ``S``
    (..., q, 3, 3) of its covariance; the errors ``common_px`` (..., n, 2, p); and the ``rows`` of each image."""

    own: Observations
    place: Index
    S: Array
    common_px: Array | None
    rows: Sequence[Index]

    @classmethod
    def of(cls, o: Observations) -> _Table:
        repeated = repeated_landmarks(o)
        where = np.full(o.n_landmarks, -1)
        where[repeated] = np.arange(repeated.size)
        place = where[o.landmark]
        alone = np.where((place < 0)[:, None, None], o.cov_landmark_J[..., o.landmark, :, :], 0.0)
        own = replace(o, landmark=np.arange(o.n), cov_landmark_J=alone, epoch_s=None, common_px=None)
        ends = np.cumsum(np.bincount(o.image, minlength=o.n_images))
        rows = np.split(np.argsort(o.image, kind="stable"), ends[:-1])
        return cls(own, place, square_root(o.cov_landmark_J[..., repeated, :, :]), o.common_px, rows)

    @property
    def unknowns(self) -> int:
        """How many images share: the mounting, places of landmarks, errors in common."""
        return (
            3 + 3 * int(self.S.shape[-3]) + (0 if self.common_px is None else int(self.common_px.shape[-1]))
        )

    def squares(self, images: Index, C_lin: Array) -> Iterator[Array]:
        """Normal equations (..., k + 1, k + 1) of the state and the residuals, image after image, all linearised at
        C_lin; some thousand sightings at once."""
        counts = np.array([self.rows[image].size for image in images])
        most = max(1, AT_ONCE // (self.unknowns * max(1, int(np.max(counts)))))
        for first in range(0, images.size, most):
            some = images[first : first + most]
            rows = np.concatenate([self.rows[image] for image in some])
            image = np.repeat(np.arange(some.size), counts[first : first + most])
            found = self._squares(some, rows, image, C_lin)
            yield from np.moveaxis(found, -3, 0)

    def _squares(self, images: Index, rows: Index, image: Index, C_lin: Array) -> Array:
        """Of some images (g,), (..., g, k + 1, k + 1), whose sightings are ``rows`` (r,), each of ``image`` (r,)."""
        o = self.own
        part = replace(
            o.select(rows),
            image=image,
            landmark=np.arange(rows.size),
            cov_attitude_E=o.cov_attitude_E[..., images, :, :],
            cov_position_J=o.cov_position_J[..., images, :, :],
            cov_landmark_J=o.cov_landmark_J[..., rows, :, :],
        )
        model = linearise(part, C_lin)
        return squares_by_image(part, model, self._design(rows, model))

    def _design(self, rows: Index, model: Linearised) -> Array:
        """Of the state, (..., r, 2, k)."""
        carried = np.flatnonzero(self.place[rows] >= 0)
        place = self.place[rows[carried]]
        by_place = -model.R[..., carried, :, :] @ self.S[..., place, :, :]
        common = np.zeros((rows.size, 2, 0)) if self.common_px is None else self.common_px[..., rows, :, :]
        batch = np.broadcast_shapes(*(part.shape[:-3] for part in (model.H, by_place, common)))
        A = np.zeros((*batch, rows.size, 2, self.unknowns))
        A[..., :3] = model.H
        for axis in range(3):
            # an index on both sides of a slice brings its axis to the front
            A[..., carried, :, 3 + 3 * place + axis] = np.moveaxis(by_place[..., axis], -2, 0)
        A[..., self.unknowns - common.shape[-1] :] = common
        return A


def _update(squares: Array, state: State, C_lin: Array) -> tuple[State, Array]:
    """One image by its normal equations at C_lin: state after it and its share of chi-square.

    The mounting is exp(x) C_lin; what was known says ``c + J^-1 x ~ N(0, .)`` with ``c = log(C_lin
    C_EK^T)``, J the left Jacobian of c.  The answer's information is turned to its own place by that of x.
    """
    c = so3.log(C_lin @ state.C_EK.mT)
    known = _moved(state.information, so3.left_jacobian(c))
    step = Adjustment.of(squares, (known, np.concatenate([-c, state.u], axis=-1)))
    return _after(step, C_lin), step.chi2


def _after(step: Adjustment, C_lin: Array) -> State:
    x = step.x[..., :3]
    turn = so3.left_jacobian(x)
    return State(so3.exp(x) @ C_lin, step.x[..., 3:], _moved(step.information, turn))


def _moved(information: Array, J: Array) -> Array:
    """Information of (J x, u) where that of (x, u) is given: ``J^-T L J^-1`` on the rotation's rows and
    columns."""
    k = information.shape[-1]
    T = np.zeros((*J.shape[:-2], k, k))
    T[...] = np.eye(k)
    T[..., :3, :3] = np.linalg.inv(J)
    return np.asarray(T.mT @ information @ T)
