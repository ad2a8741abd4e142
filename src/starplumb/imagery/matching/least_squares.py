"""Least-squares matching: where a chip of the reference lies in a window of a raw image, to thousandths of a pixel.

The window is modelled as ``I(p) = g T(d + (I + B) (p - c)) + o``: the template T shifted by d, distorted by B (2, 2),
which the camera model knows to :data:`SHAPE`, its contrast and brightness changed by g and o; c is the window's centre.
The unknowns (d, B, g, o) are found by Gauss-Newton steps under Tukey's weights, in three passes: with the template as
it is; with the template blurred to the window's sharpness; and with residuals made white by their own spectrum, so that
another season, another band or a coarse reference weigh what they deserve.

Source: A. W. Gruen, Adaptive least squares correlation, South African Journal of Photogrammetry 14 (1985).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .sandwich import inverted, long_run
from .sharpness import blur_between
from .template import Template
from .whitening import Whitener

Array = NDArray[np.float64]

SHAPE = 0.02
"""Sigma of each element of B: scale, shear and rotation of a chip as the camera model knows them."""
MOST_SHAPE = 0.15
"""A chip more distorted than this is not the chip."""
REACH_PX = 4.0
"""A chip is not found farther than this from where the search began."""
STEPS = 25
_TUKEY = 4.685
REST_PX = 2e-4
"""Steps smaller than this are rest; their square is in every covariance."""
_SMALL = 0.05
"""So is a step this small beside the formal sigma: it changes nothing that could be seen."""
_WEIGHT = 0.05
"""Pixels of less weight are left out."""


@dataclass(frozen=True)
class Match:
    """A chip found in a window (n, m).

    ``place_px`` (2,) is where the template's centre lies in the window, x and y from its first pixel, and
    ``covariance_px2`` (2, 2) the covariance of its error; ``shape`` (2, 2) is B; ``agreement`` the weighted correlation
    of window and template, negative where their contrasts are reversed; ``kept`` the part of the pixels with weight.
    ``residual`` (n, m), in the window's values, and ``weight`` (n, m) are of the last pass.
    """

    place_px: Array
    covariance_px2: Array
    shape: Array
    gain: float
    offset: float
    blur_px: float
    agreement: float
    kept: float
    noise: float
    residual: Array
    weight: Array


@dataclass(frozen=True)
class _State:
    """The unknowns, and of the last step residuals, Jacobian, weights and curvature by pixel and the normal matrix."""

    d: Array
    B: Array
    gain: float
    offset: float
    r: Array
    J: Array
    w: Array
    curvature: Array
    scale: float
    N: Array
    done: bool


@dataclass(frozen=True)
class _Chip:
    """A window and the pixels of it that may be used, with their places from its centre; ``seen`` are those whose
    filtered residual counts."""

    window: Array
    use: Array
    seen: Array
    x: Array
    y: Array

    @classmethod
    def of(cls, window: Array, use: NDArray[np.bool_] | None) -> _Chip:
        rows, columns = window.shape
        y, x = np.mgrid[:rows, :columns].astype(np.float64)
        good = np.isfinite(window) if use is None else use & np.isfinite(window)
        filled = np.where(good, window, 0.0)
        used = good.astype(np.float64)
        return cls(filled, used, used, x - 0.5 * (columns - 1), y - 0.5 * (rows - 1))

    def under(self, whitener: Whitener, good: NDArray[np.bool_]) -> _Chip:
        """The same where a filter's residuals come from good pixels only."""
        seen = whitener.reach(good & (self.use > 0.0))
        return replace(self, use=self.use * good, seen=seen.astype(np.float64))

    @property
    def centre(self) -> Array:
        rows, columns = self.window.shape
        return 0.5 * np.array([columns - 1.0, rows - 1.0])


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
        return _match(template, chip, d)
    except np.linalg.LinAlgError:
        return None


def _match(template: Template, chip: _Chip, d: Array) -> Match | None:
    first = _settled(template, chip, _begin(d), d, Whitener.none())
    if first is None:
        return None
    pulled = (chip.x, chip.y, first.d, first.B)
    blur = blur_between(template, chip.window, _places(*pulled), first.w)
    sharp = template.blurred(blur)
    second = _settled(sharp, chip, first, d, Whitener.none()) if blur > 0.0 else first
    if second is None:
        return None
    good = second.w > _WEIGHT
    whitener = Whitener.of(second.r, good)
    if not whitener.acts:
        return _told(sharp, chip, second, blur)
    # what the first passes left out stays out: a changed field must not leak into its neighbours
    last = _settled(sharp, chip.under(whitener, good), second, d, whitener)
    return None if last is None else _told(sharp, chip, last, blur)


def _begin(d: Array) -> _State:
    none = np.empty(0)
    return _State(d, np.zeros((2, 2)), np.nan, np.nan, none, none, none, none, np.nan, none, False)


def _places(x: Array, y: Array, d: Array, B: Array) -> tuple[Array, Array]:
    """Where in the template the pixels lie."""
    return d[0] + (1.0 + B[0, 0]) * x + B[0, 1] * y, d[1] + B[1, 0] * x + (1.0 + B[1, 1]) * y


def _settled(
    template: Template, chip: _Chip, state: _State, start: Array, whitener: Whitener
) -> _State | None:
    """The state at which the steps come to rest; None where they do not, or leave what is possible."""
    for _ in range(STEPS):
        state = _step(template, chip, state, whitener)
        if np.hypot(*(state.d - start)) > REACH_PX or np.abs(state.B).max() > MOST_SHAPE:
            return None
        if state.done:
            return state
    return None


def _step(template: Template, chip: _Chip, state: _State, whitener: Whitener) -> _State:
    """One Gauss-Newton step."""
    place = _places(chip.x, chip.y, state.d, state.B)
    T = template.at(*place)
    gx, gy = template.slopes_at(*place)
    w = state.w if state.w.size else chip.use
    gain, offset = (state.gain, state.offset) if np.isfinite(state.gain) else _radiometry(T, chip.window, w)
    r = chip.seen * whitener(chip.use * (chip.window - gain * T - offset))
    slope = gain * np.stack([gx, gy], axis=-1)
    columns = [slope, slope[..., :1] * chip.x[..., None], slope[..., :1] * chip.y[..., None]]
    columns += [slope[..., 1:] * chip.x[..., None], slope[..., 1:] * chip.y[..., None]]
    level = float(np.sum(w * T) / max(np.sum(w), 1e-9))
    columns += [(T - level)[..., None], np.ones((*T.shape, 1))]
    J = chip.seen[..., None] * whitener(chip.use[..., None] * np.concatenate(columns, axis=-1))
    scale = _spread(r, chip.seen)
    w, curvature = _tukey(r / (_TUKEY * scale), chip.seen)
    p = J.shape[-1]
    flat = (J * w[..., None]).reshape(-1, p)
    s2 = float(np.sum(w * r**2)) / max(float(w.sum()) - p, 1.0)
    prior = np.zeros(p)
    prior[2:6] = s2 / SHAPE**2
    N = flat.mT @ J.reshape(-1, p) + np.diag(prior)
    rhs = flat.mT @ r.ravel()
    rhs[2:6] -= prior[2:6] * state.B.ravel()
    inverse = inverted(N)
    step = inverse @ rhs
    long = float(np.hypot(step[0], step[1]))
    sigma = np.sqrt(s2 * max(float(np.trace(inverse[:2, :2])), 0.0))
    rest = state.w.size > 0 and long < max(REST_PX, _SMALL * sigma)
    step = step / max(long, 1.0)
    return _State(
        state.d + step[:2],
        state.B + step[2:6].reshape(2, 2),
        gain + step[6],
        offset + step[7] - step[6] * level,
        r,
        J,
        w,
        curvature,
        float(np.sqrt(s2)),
        N,
        rest,
    )


def _radiometry(T: Array, z: Array, w: Array) -> tuple[float, float]:
    """Gain and offset by weighted regression."""
    total = max(float(w.sum()), 1e-9)
    T_mean, z_mean = float(np.sum(w * T)) / total, float(np.sum(w * z)) / total
    power = float(np.sum(w * (T - T_mean) ** 2))
    gain = float(np.sum(w * (T - T_mean) * (z - z_mean))) / max(power, 1e-300)
    return gain, z_mean - gain * T_mean


def _spread(r: Array, use: Array) -> float:
    """Robust standard deviation of the residuals in use."""
    used = r[use > 0.0]
    if not used.size:
        raise np.linalg.LinAlgError("no pixel is left")
    return 1.4826 * float(np.median(np.abs(used))) + 1e-12


def _tukey(k: Array, use: Array) -> tuple[Array, Array]:
    """Weights, and the slope of what they make of a residual."""
    inside = np.maximum(1.0 - k**2, 0.0)
    return use * inside**2, use * np.where(inside > 0.0, inside * (1.0 - 5.0 * k**2), 0.0)


def _told(template: Template, chip: _Chip, state: _State, blur_px: float) -> Match:
    covariance = _covariance(state)
    back = np.linalg.inv(np.eye(2) + state.B)
    away = back @ (template.centre - state.d)
    # of place = c + (I + B)^-1 (centre - d) the slope is -(I + B)^-1 (dd + dB away)
    turn = -back @ np.concatenate([np.eye(2), np.kron(np.eye(2), away)], axis=1)
    T = template.at(*_places(chip.x, chip.y, state.d, state.B))
    z = chip.use * (chip.window - state.gain * T - state.offset)
    return Match(
        place_px=chip.centre + away,
        covariance_px2=turn @ covariance[:6, :6] @ turn.mT + REST_PX**2 * np.eye(2),
        shape=state.B,
        gain=state.gain,
        offset=state.offset,
        blur_px=blur_px,
        agreement=_agreement(T, chip.window, state.w) * float(np.sign(state.gain)),
        kept=float(np.sum(state.w > _WEIGHT)) / max(float(chip.use.size), 1.0),
        noise=state.scale,
        residual=z,
        weight=state.w,
    )


def _agreement(T: Array, z: Array, w: Array) -> float:
    total = max(float(w.sum()), 1e-9)
    a, b = T - np.sum(w * T) / total, z - np.sum(w * z) / total
    power = float(np.sum(w * a * a) * np.sum(w * b * b))
    return abs(float(np.sum(w * a * b))) / float(np.sqrt(power)) if power > 0.0 else 0.0


def _covariance(state: _State) -> Array:
    """The sandwich (p, p) of the unknowns; raises LinAlgError where weights leave no curvature."""
    p = state.J.shape[-1]
    prior = np.zeros(p)
    prior[2:6] = 1.0 / SHAPE**2
    s2 = state.scale**2
    bread = (state.J * state.curvature[..., None]).reshape(-1, p).mT @ state.J.reshape(-1, p)
    inverse = inverted(bread + s2 * np.diag(prior))
    leverage = state.w * np.einsum("...i,ij,...j->...", state.J, inverted(state.N), state.J)
    scores = state.J * (state.w * state.r / np.maximum(1.0 - leverage, 0.2))[..., None]
    covariance = inverse @ (long_run(scores) + s2**2 * np.diag(prior)) @ inverse.mT
    if not np.all(np.isfinite(covariance)):
        raise np.linalg.LinAlgError("the covariance is not finite")
    return np.asarray(covariance)
