"""Least-squares matching: where a chip of the reference lies in a window of a raw image, to thousandths of a pixel.

The window is modelled as ``I(p) = g F(d + (I + B) (p - c)) + o``: F is the template made like the window
(:mod:`.likeness`), shifted by d and distorted by B (2, 2), which the camera model knows to :data:`SHAPE`; c is the
window's centre.  Rounds alternate (:mod:`.rounds`): with the place held, F, the weights and the noise are told from the
window; with these held, (d, B, g, o) are found.

Where much is left that goes with the template's own edges, as another band reversed some of them, what a round finds
hangs on where it was held: ``d = phi(d_0)``.  Its error is then carried on by rounds without end, ``e + phi' e + ...``,
and the covariance is that of ``(I - phi')^-1 e``.

Source: A. W. Gruen, Adaptive least squares correlation, South African Journal of Photogrammetry 14 (1985).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .likeness import Layers
from .rounds import SEEN, Pixels, Round, State, held_at, prior_of, settled
from .sandwich import inverted, long_run
from .template import Template

Array = NDArray[np.float64]

ROUNDS = 5
NEAR_PX = 0.1
"""A round that moves the place by less is the last but one."""
REST_PX = 2e-4
"""Steps smaller than this are rest; their square is in every covariance."""
BESIDE_PX = 0.2
"""How far beside the last round others are held, to see how far its place hangs on where it was held."""
SURE = 0.8
"""Correlation from which a place hangs on nothing but the window."""
MOST_PULL = 0.85
"""Part of a step that the place found may follow: more is no rest."""
BADLY, ROUGHLY = 0.65, 1.2
"""Correlation below which two steps tell only roughly how a place hangs on where its round was held, and by how much
sigmas are larger for that."""
MOST_ASIDE = 0.75
"""A place is not told farther from a window's centre than this part of the way to its border."""
COHERENT = 1.2
"""By how much sigmas are larger where residuals are not white: they go along edges farther than the sandwich's lags."""


@dataclass(frozen=True)
class Match:
    """A chip found in a window (n, m).

    ``place_px`` (2,) is where the template's ``point_px`` (2,), x and y from its centre, lies in the window, x and y
    from its first pixel, and ``covariance_px2`` (2, 2) the covariance of its error: the place that is known best
    (:func:`best_known`); ``shape`` (2, 2) is B; ``agreement`` the correlation that the template explains, in the values
    that were matched, negative where contrasts are reversed; ``kept`` the part of the pixels with weight; ``gain`` and
    ``blur_px`` are those from template to window.  ``residual`` (n, m), in the window's values, and ``weight`` (n, m)
    are of the last round.
    """

    place_px: Array
    point_px: Array
    covariance_px2: Array
    shape: Array
    gain: float
    blur_px: float
    agreement: float
    kept: float
    residual: Array
    weight: Array


def match(
    template: Template, window: Array, start_px: Array, use: NDArray[np.bool_] | None = None
) -> Match | None:
    """Find a template in a window (n, m) in which its centre is expected at ``start_px`` (2,), x and y.

    Of the window only pixels in ``use`` (n, m) count, and none that is NaN.  None where the search leaves
    :data:`REACH_PX`, does not come to rest, or the window has no structure to find a place by.
    """
    chip = Pixels.of(window, use)
    d = template.centre - (np.asarray(start_px, dtype=np.float64) - chip.centre)
    try:
        return _match(Layers(template), chip, d)
    except np.linalg.LinAlgError:
        return None


def _match(layers: Layers, chip: Pixels, start: Array) -> Match | None:
    state, moved = State.at(start, np.zeros((2, 2))), np.inf
    for k in range(1, ROUNDS + 1):
        last = k == ROUNDS or moved < NEAR_PX
        held = held_at(layers, chip, state)
        found = settled(held, state, start, REST_PX if last else 0.5 * NEAR_PX)
        if found is None:
            return None
        if last:
            told = _told(held, found)
            sure = abs(told.agreement) > SURE
            return told if sure else carried_on(told, _pull(layers, chip, state, found))
        moved = float(np.hypot(*(found.d - state.d)))
        state = State.at(found.d, found.B)
    return None


def _pull(layers: Layers, chip: Pixels, held: State, found: State) -> Array:
    """How the place found in a round follows the place at which it was ``held``, (2, 2); NaN where it has no rest."""
    pulled = np.full((2, 2), np.nan)
    for axis, step in enumerate(BESIDE_PX * np.eye(2)):
        state = State.at(held.d + step, held.B)
        beside = settled(held_at(layers, chip, state), state, held.d, 0.1 * NEAR_PX)
        if beside is not None:
            pulled[:, axis] = (beside.d - found.d) / BESIDE_PX
    return pulled


def carried_on(told: Match, pull: Array) -> Match | None:
    """A match with the error that rounds without end would have, of which each has ``pull`` (2, 2) times that of the
    one before; None where these would not come to rest."""
    if not np.all(np.isfinite(pull)) or np.abs(np.linalg.eigvals(pull)).max() > MOST_PULL:
        return None
    on = np.linalg.inv(np.eye(2) - pull) * (ROUGHLY if abs(told.agreement) < BADLY else 1.0)
    return replace(told, covariance_px2=on @ told.covariance_px2 @ on.mT)


def _told(held: Round, state: State) -> Match:
    chip, covariance = held.chip, _covariance(held, state)
    covariance *= 1.0 if held.contrast is None else COHERENT**2
    straight = np.eye(2) + state.B
    x = best_known(covariance[:6, :6], MOST_ASIDE * chip.centre)
    # of place = (I + B)^-1 (point - d) the slope is -(I + B)^-1 (dd + dB place)
    turn = -np.linalg.solve(straight, np.concatenate([np.eye(2), np.kron(np.eye(2), x)], axis=1))
    sign = float(np.sign(held.look.gains[0] * np.sum(state.w * held.local)))
    left = chip.window - held.model(state)
    if held.contrast is not None:
        left = left - held.contrast.mean(left)
    return Match(
        place_px=chip.centre + x,
        point_px=state.d + straight @ x - held.template.centre,
        covariance_px2=turn @ covariance[:6, :6] @ turn.mT + REST_PX**2 * np.eye(2),
        shape=state.B,
        gain=float(state.gain * held.look.gains[0] * np.mean(held.local)),
        blur_px=held.look.blur_px,
        agreement=sign * _agreement(held.filtered(chip.window), state.r, state.w),
        kept=float(np.sum(state.w > SEEN)) / max(float(chip.use.size), 1.0),
        residual=chip.use * left,
        weight=state.w,
    )


def best_known(covariance: Array, most: Array) -> Array:
    """The place x (2,), at most ``most`` (2,) to each side, at which ``d + B x`` has the least variance: of (d, B) with
    this ``covariance`` (6, 6), B row by row, where its trace is ``tr V_dd + 2 b x + x A x``.

    Under cloud what is seen lies to one side, and the middle is known only as well as B carries it there.
    """
    A = covariance[2:4, 2:4] + covariance[4:6, 4:6]
    b = covariance[0, 2:4] + covariance[1, 4:6]
    return np.clip(-np.linalg.solve(A, b), -most, most)


def _agreement(z: Array, r: Array, w: Array) -> float:
    """The correlation that leaves residuals r of values z (n, m)."""
    z = z - np.sum(w * z) / max(float(w.sum()), 1e-9)
    power = float(np.sum(w * z * z))
    return float(np.sqrt(max(1.0 - float(np.sum(w * r * r)) / power, 0.0))) if power > 0.0 else 0.0


def _covariance(held: Round, state: State) -> Array:
    """The sandwich (8, 8) of the unknowns; raises LinAlgError where weights leave no curvature."""
    J, s2 = held.J, state.scale**2
    prior = np.diag(prior_of(s2))
    flat = J.reshape(-1, 8)
    inverse = inverted((flat * state.curvature.reshape(-1, 1)).mT @ flat + prior)
    leverage = state.w * np.sum((J @ inverted(state.N)) * J, axis=-1)
    scores = J * (state.w * state.r / np.maximum(1.0 - leverage, 0.2))[..., None]
    covariance = inverse @ (long_run(scores) + s2 * prior) @ inverse.mT
    if not np.all(np.isfinite(covariance)):
        raise np.linalg.LinAlgError("the covariance is not finite")
    return np.asarray(covariance)
