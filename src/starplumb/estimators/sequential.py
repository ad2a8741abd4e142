"""The recursive estimator that (32) of Lebedev and Tkachenko (2012) leaves open: a Kalman filter over the
images."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..physics.covariance import square_root
from ..physics.errors import InputError
from ..solve.adjustment import Adjustment, solve
from ..solve.chunks import repeated_landmarks
from ..table.equation import linearise
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
    another runs again with all images linearised at the last answer.  Of several, the first begins to linearise at
    the closed form, unless ``start`` is ``"model"``.  ``prior_sigma`` (rad about E) of the
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
        for number in range(self.passes):
            state, chi2 = self._start(o, C_EK), np.zeros(batch)
            for after, cost in self._images(o, state, reference, 1 if number else LOCAL_STEPS):
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
        return (state for state, _ in self._images(observations, start, None, LOCAL_STEPS))

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
        self, o: Observations, state: State, reference: Array | None, steps: int
    ) -> Iterator[tuple[State, Array]]:
        """States after each image and what the image adds to chi-square; linearised so many times, first at the
        reference or the state."""
        if any(self.drift) and o.epoch_s is None:
            raise InputError(
                "sequential: found a drift but no epoch_s in the table, wanted the epochs of the images"
            )
        epoch_s = np.arange(o.n_images, dtype=np.float64) if o.epoch_s is None else o.epoch_s
        shared, last_s = _Shared.of(o), None
        ordered, counts = np.argsort(o.image, kind="stable"), np.bincount(o.image, minlength=o.n_images)
        starts = np.cumsum(counts) - counts
        for image in np.argsort(epoch_s, kind="stable"):
            if counts[image] == 0:
                continue
            if last_s is not None:
                state = self._predict(state, epoch_s[image] - last_s)
            last_s = epoch_s[image]
            one = shared.image(ordered[starts[image] : starts[image] + counts[image]], image)
            before, C_lin = state, state.C_EK if reference is None else reference
            for _ in range(steps):
                state, cost = _update(one, before, C_lin)
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
class _Image:
    """What one image adds: its table ``part``, with the place errors of landmarks that no other image shares;
    ``carried`` (r,) its sightings of the others, their ``place`` (r,) in the state and the root ``S`` (..., r, 3, 3) of
    their covariance; and ``common_px`` (..., n, 2, p)."""

    part: Observations
    carried: Index
    place: Index
    S: Array
    common_px: Array | None


@dataclass(frozen=True)
class _Shared:
    """A table with what images share: the landmarks ``repeated`` (q,) and the root ``S`` (..., q, 3, 3) of each."""

    o: Observations
    repeated: Index
    S: Array

    @classmethod
    def of(cls, o: Observations) -> _Shared:
        repeated = repeated_landmarks(o)
        return cls(o, repeated, square_root(o.cov_landmark_J[..., repeated, :, :]))

    def image(self, rows: Index, image: int) -> _Image:
        """The sightings ``rows`` of one image, and none but its own landmarks."""
        o, one = self.o, slice(image, image + 1)
        landmarks, landmark = np.unique(o.landmark[rows], return_inverse=True)
        shared = np.isin(landmarks, self.repeated)
        part = replace(
            o.select(rows),
            image=np.zeros_like(rows),
            landmark=landmark,
            cov_attitude_E=o.cov_attitude_E[..., one, :, :],
            cov_position_J=o.cov_position_J[..., one, :, :],
            cov_landmark_J=np.where(shared[:, None, None], 0.0, o.cov_landmark_J[..., landmarks, :, :]),
            epoch_s=None,
            common_px=None,
        )
        carried = np.flatnonzero(shared[landmark])
        place = np.searchsorted(self.repeated, o.landmark[rows[carried]])
        common = None if o.common_px is None else o.common_px[..., rows, :, :]
        return _Image(part, carried, place, self.S[..., place, :, :], common)


def _update(one: _Image, state: State, C_lin: Array) -> tuple[State, Array]:
    """One image, linearised at C_lin: state after it and its share of chi-square.

    The mounting is exp(x) C_lin; what was known says ``c + J^-1 x ~ N(0, .)`` with ``c = log(C_lin
    C_EK^T)``, J the left Jacobian of c.  The answer's information is turned to its own place by that of x.
    """
    part = one.part
    model = linearise(part, C_lin)
    batch = np.broadcast_shapes(model.H.shape[:-3], model.R.shape[:-3], one.S.shape[:-3], state.u.shape[:-1])
    A = np.zeros((*batch, part.n, 2, 3 + state.u.shape[-1]))
    A[..., :3] = model.H
    for k, place, S in zip(one.carried, one.place, np.moveaxis(one.S, -3, 0), strict=True):
        first = 3 + 3 * place
        A[..., k, :, first : first + 3] = -model.R[..., k, :, :] @ S
    if one.common_px is not None:
        A[..., A.shape[-1] - one.common_px.shape[-1] :] = one.common_px
    c = so3.log(C_lin @ state.C_EK.mT)
    known = _moved(state.information, so3.left_jacobian(c))
    step = solve(part, model, A, known, np.concatenate([-c, state.u], axis=-1))
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
