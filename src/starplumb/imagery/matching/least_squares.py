"""Least-squares matching: where a chip of the reference lies in a window of a raw image, to thousandths of a pixel.

The window is modelled as ``I(p) = g F(d + (I + B) (p - c)) + o``: F is the template made like the window
(:mod:`.likeness`), shifted by d and distorted by B (2, 2), which the camera model knows to :data:`SHAPE`; c is the
window's centre.  Rounds alternate: with the place held, F, the weights and the noise are told from the window; with
these held, (d, B, g, o) are found by Gauss-Newton steps under Tukey's weights.  Where what is left is not white (cloud,
another season or band, a coarse reference), contrast and brightness are local (:mod:`.contrast`) and the residuals are
made white by their own correlation (:mod:`.whitening`), so that each pixel weighs what it deserves.

Source: A. W. Gruen, Adaptive least squares correlation, South African Journal of Photogrammetry 14 (1985).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .contrast import Contrast
from .likeness import Layers, Look, look_of
from .sandwich import inverted, long_run
from .template import Template
from .weights import WIDTH, spread, tukey
from .whitening import Whitener, correlated

Array = NDArray[np.float64]
Filter = Callable[[Array], Array]

SHAPE = 0.02
"""Sigma of each element of B: scale, shear and rotation of a chip as the camera model knows them."""
MOST_SHAPE = 0.15
"""A chip more distorted than this is not the chip."""
REACH_PX = 4.0
"""A chip is not found farther than this from where the search began."""
STEPS = 25
ROUNDS = 5
NEAR_PX = 0.1
"""A round that moves the place by less is the last but one."""
REST_PX = 2e-4
"""Steps smaller than this are rest; their square is in every covariance."""
_SMALL = 0.05
"""So is a step this small beside the formal sigma: it changes nothing that could be seen."""
_WEIGHT = 0.05
"""Pixels of less weight are left out."""
_SHOWN = 0.4
"""Pixels in whose neighbourhood fewer weights are left show something else, as cloud does."""
_LEAST_SHOWN = 0.15
"""Where fewer of a window's pixels would be left, all of them count."""
MOST_ASIDE = 0.75
"""A place is not told farther from a window's centre than this part of the way to its border."""
COHERENT = 1.2
"""By how much sigmas are larger where residuals are not white: they go along edges farther than the sandwich's lags."""
_EXACT = 5e-3
"""Spread of what is left, in parts of the window's: less is not the window's doing."""
_HELD = 1e-3
"""Weight of g = 1 and o = 0 where neither can be told from local contrast and brightness."""


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


@dataclass(frozen=True)
class _State:
    """The unknowns, and of the last step residuals and weights, curvature by pixel and the normal matrix."""

    d: Array
    B: Array
    gain: float
    offset: float
    r: Array
    w: Array
    curvature: Array
    scale: float
    N: Array
    done: bool

    @classmethod
    def at(cls, d: Array, B: Array) -> _State:
        none = np.empty(0)
        return cls(d, B, 1.0, 0.0, none, none, none, np.nan, none, False)


@dataclass(frozen=True)
class _Chip:
    """A window and the pixels of it that may be used, with their places from its centre."""

    window: Array
    use: Array
    x: Array
    y: Array

    @classmethod
    def of(cls, window: Array, use: NDArray[np.bool_] | None) -> _Chip:
        rows, columns = window.shape
        y, x = np.mgrid[:rows, :columns].astype(np.float64)
        good = np.isfinite(window) if use is None else use & np.isfinite(window)
        filled = np.where(good, window, 0.0)
        return cls(filled, good.astype(np.float64), x - 0.5 * (columns - 1), y - 0.5 * (rows - 1))

    def showing(self, weight: Array) -> _Chip:
        """The same without places where few pixels have weight."""
        from scipy.ndimage import gaussian_filter

        near = gaussian_filter(np.stack([weight, self.use]), (0.0, 2.0, 2.0))
        use = self.use * (near[0] > _SHOWN * near[1])
        return replace(self, use=use) if use.sum() > _LEAST_SHOWN * use.size else self

    @property
    def centre(self) -> Array:
        rows, columns = self.window.shape
        return 0.5 * np.array([columns - 1.0, rows - 1.0])


@dataclass(frozen=True)
class _Round:
    """What is held while the place is sought: the template made like the window, the window's pixels, the ``gain`` of
    each, the filter of residuals, the pixels ``seen`` whose filtered residuals count, and the Jacobian (n, m, 8)."""

    template: Template
    chip: _Chip
    look: Look
    contrast: Contrast | None
    filter: Filter
    seen: Array
    J: Array
    level: float

    @property
    def local(self) -> Array | float:
        return 1.0 if self.contrast is None else self.contrast.gain

    def model(self, state: _State) -> Array:
        """The window (n, m) that the unknowns give."""
        T = self.template.at(*_places(self.chip, state))
        return np.asarray(state.gain * self.local * T + state.offset)

    def filtered(self, values: Array) -> Array:
        return self.seen * self.filter(self.chip.use * values)


def match(
    template: Template, window: Array, start_px: Array, use: NDArray[np.bool_] | None = None
) -> Match | None:
    """Find a template in a window (n, m) in which its centre is expected at ``start_px`` (2,), x and y.

    Of the window only pixels in ``use`` (n, m) count, and none that is NaN.  None where the search leaves
    :data:`REACH_PX`, does not come to rest, or the window has no structure to find a place by.
    """
    chip = _Chip.of(window, use)
    d = template.centre - (np.asarray(start_px, dtype=np.float64) - chip.centre)
    try:
        return _match(Layers(template), chip, d)
    except np.linalg.LinAlgError:
        return None


def _match(layers: Layers, chip: _Chip, start: Array) -> Match | None:
    state, moved = _State.at(start, np.zeros((2, 2))), np.inf
    for k in range(1, ROUNDS + 1):
        last = k == ROUNDS or moved < NEAR_PX
        held = _round(layers, chip, state)
        found = _settled(held, state, start, REST_PX if last else 0.5 * NEAR_PX)
        if found is None or last:
            return None if found is None else _told(held, found)
        moved = float(np.hypot(*(found.d - state.d)))
        state = _State.at(found.d, found.B)
    return None


def _round(layers: Layers, chip: _Chip, state: _State) -> _Round:
    """What the window tells while the place is held."""
    place = _places(chip, state)
    apart = layers.at(*place)
    look = look_of(apart, chip.window, chip.use)
    template, T = layers.like(look), look.offset + apart @ look.gains
    if _exact(look, chip) or not correlated(look.residual, look.weight > _WEIGHT):
        return _with_slopes(_Round(template, chip, look, None, _as_it_is, chip.use, chip.x, 0.0), state, T)
    chip = chip.showing(look.weight)
    contrast = Contrast.of(T, chip.window, chip.use)
    left = contrast(chip.window - contrast.gain * T)
    good = tukey(left / (WIDTH * spread(left, chip.use)), chip.use)[0] > _WEIGHT
    whitener = Whitener.of(left, good)
    # what is left out stays out: a changed field must not leak into its neighbours
    seen = whitener.reach(good).astype(np.float64) if whitener.acts else chip.use

    def both(values: Array) -> Array:
        return whitener(contrast(values))

    return _with_slopes(_Round(template, chip, look, contrast, both, seen, chip.x, 0.0), state, T)


def _exact(look: Look, chip: _Chip) -> bool:
    """Whether no more is left than what comes of interpolating between the template's samples."""
    level = float(np.median(chip.window[chip.use > 0.0]))
    return spread(look.residual, chip.use) < _EXACT * spread(chip.window - level, chip.use)


def _as_it_is(values: Array) -> Array:
    return values


def _with_slopes(held: _Round, state: _State, T: Array) -> _Round:
    """With the Jacobian of the window by d, B, g and o, filtered; T (n, m) is the template at its pixels."""
    chip = held.chip
    gx, gy = held.template.slopes_at(*_places(chip, state))
    gx, gy = gx * held.local, gy * held.local
    level = (
        0.0 if held.contrast is not None else float(np.sum(chip.use * T) / max(float(chip.use.sum()), 1.0))
    )
    columns = (
        gx,
        gy,
        gx * chip.x,
        gx * chip.y,
        gy * chip.x,
        gy * chip.y,
        held.local * (T - level),
        np.ones_like(T),
    )
    J = held.filter(chip.use[..., None] * np.stack(columns, axis=-1))
    return replace(held, J=held.seen[..., None] * J, level=level)


def _places(chip: _Chip, state: _State) -> tuple[Array, Array]:
    """Where in the template the pixels lie."""
    d, B = state.d, state.B
    x = d[0] + (1.0 + B[0, 0]) * chip.x + B[0, 1] * chip.y
    return x, d[1] + B[1, 0] * chip.x + (1.0 + B[1, 1]) * chip.y


def _settled(held: _Round, state: _State, start: Array, rest_px: float) -> _State | None:
    """The state at which the steps come to rest; None where they do not, or leave what is possible."""
    for k in range(STEPS):
        state = _step(held, state, rest_px, k > 0)
        if np.hypot(*(state.d - start)) > REACH_PX or np.abs(state.B).max() > MOST_SHAPE:
            return None
        if state.done:
            return state
    return None


def _prior(s2: float) -> Array:
    """Weights (8,) of no distortion, g = 1 and o = 0."""
    return s2 * np.array([0.0, 0.0, *[SHAPE**-2] * 4, _HELD, _HELD])


def _step(held: _Round, state: _State, rest_px: float, may_rest: bool) -> _State:
    """One Gauss-Newton step."""
    r = held.filtered(held.chip.window - held.model(state))
    w, curvature = tukey(r / (WIDTH * spread(r, held.seen)), held.seen)
    flat = held.J.reshape(-1, 8)
    s2 = float(np.sum(w * r**2)) / max(float(w.sum()) - 8.0, 1.0)
    prior, weighted = _prior(s2), (flat * w.reshape(-1, 1)).mT
    N = weighted @ flat + np.diag(prior)
    off = np.array(
        [0.0, 0.0, *state.B.ravel(), state.gain - 1.0, state.offset + held.level * (state.gain - 1.0)]
    )
    inverse = inverted(N)
    step = inverse @ (weighted @ r.ravel() - prior * off)
    long = float(np.hypot(step[0], step[1]))
    sigma = np.sqrt(s2 * max(float(np.trace(inverse[:2, :2])), 0.0))
    rest = may_rest and long < max(rest_px, _SMALL * sigma)
    step = step / max(long, 1.0)
    d, B = state.d + step[:2], state.B + step[2:6].reshape(2, 2)
    offset = state.offset + step[7] - step[6] * held.level
    return _State(d, B, state.gain + step[6], offset, r, w, curvature, float(np.sqrt(s2)), N, rest)


def _told(held: _Round, state: _State) -> Match:
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
        kept=float(np.sum(state.w > _WEIGHT)) / max(float(chip.use.size), 1.0),
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


def _covariance(held: _Round, state: _State) -> Array:
    """The sandwich (8, 8) of the unknowns; raises LinAlgError where weights leave no curvature."""
    J, s2 = held.J, state.scale**2
    prior = np.diag(_prior(s2))
    flat = J.reshape(-1, 8)
    inverse = inverted((flat * state.curvature.reshape(-1, 1)).mT @ flat + prior)
    leverage = state.w * np.sum((J @ inverted(state.N)) * J, axis=-1)
    scores = J * (state.w * state.r / np.maximum(1.0 - leverage, 0.2))[..., None]
    covariance = inverse @ (long_run(scores) + s2 * prior) @ inverse.mT
    if not np.all(np.isfinite(covariance)):
        raise np.linalg.LinAlgError("the covariance is not finite")
    return np.asarray(covariance)
