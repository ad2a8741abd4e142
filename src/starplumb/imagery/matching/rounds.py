"""A round of matching: what a window tells while the place is held, and the steps by which the place comes to rest.

With the place held, the template is made like the window (:mod:`.likeness`).  Where what is left is not white (cloud,
another season or band, a coarse reference), contrast and brightness are local (:mod:`.contrast`) and the residuals are
made white by their own correlation (:mod:`.whitening`), so that each pixel weighs what it deserves.  With these held,
the unknowns are found by Gauss-Newton steps under Tukey's weights.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .contrast import Contrast
from .likeness import Layers, Look, look_of
from .sandwich import inverted
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
SEEN = 0.05
"""Pixels of less weight are left out."""
_SMALL = 0.05
"""A step this small beside the formal sigma is rest: it changes nothing that could be seen."""
_SHOWN = 0.4
"""Pixels in whose neighbourhood fewer weights are left show something else, as cloud does."""
_LEAST_SHOWN = 0.15
"""Where fewer of a window's pixels would be left, all of them count."""
_EXACT = 5e-3
"""Spread of what is left, in parts of the window's: less is not the window's doing."""
_HELD = 1e-3
"""Weight of g = 1 and o = 0 where neither can be told from local contrast and brightness."""


@dataclass(frozen=True)
class State:
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
    def at(cls, d: Array, B: Array) -> State:
        none = np.empty(0)
        return cls(d, B, 1.0, 0.0, none, none, none, np.nan, none, False)


@dataclass(frozen=True)
class Pixels:
    """A window and the pixels of it that may be used, with their places from its centre."""

    window: Array
    use: Array
    x: Array
    y: Array

    @classmethod
    def of(cls, window: Array, use: NDArray[np.bool_] | None) -> Pixels:
        rows, columns = window.shape
        y, x = np.mgrid[:rows, :columns].astype(np.float64)
        good = np.isfinite(window) if use is None else use & np.isfinite(window)
        filled = np.where(good, window, 0.0)
        return cls(filled, good.astype(np.float64), x - 0.5 * (columns - 1), y - 0.5 * (rows - 1))

    def showing(self, weight: Array) -> Pixels:
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
class Round:
    """What is held while the place is sought: the template made like the window, the window's pixels, the ``gain`` of
    each, the filter of residuals, the pixels ``seen`` whose filtered residuals count, and the Jacobian (n, m, 8)."""

    template: Template
    chip: Pixels
    look: Look
    contrast: Contrast | None
    filter: Filter
    seen: Array
    J: Array
    level: float

    @property
    def local(self) -> Array | float:
        return 1.0 if self.contrast is None else self.contrast.gain

    def model(self, state: State) -> Array:
        """The window (n, m) that the unknowns give."""
        T = self.template.at(*_places(self.chip, state))
        return np.asarray(state.gain * self.local * T + state.offset)

    def filtered(self, values: Array) -> Array:
        return self.seen * self.filter(self.chip.use * values)


def held_at(layers: Layers, chip: Pixels, state: State) -> Round:
    """What the window tells while the place is held."""
    place = _places(chip, state)
    apart = layers.at(*place)
    look = look_of(apart, chip.window, chip.use)
    template, T = layers.like(look), look.offset + apart @ look.gains
    if _exact(look, chip) or not correlated(look.residual, look.weight > SEEN):
        return _with_slopes(Round(template, chip, look, None, _as_it_is, chip.use, chip.x, 0.0), state, T)
    chip = chip.showing(look.weight)
    contrast = Contrast.of(T, chip.window, chip.use)
    left = contrast(chip.window - contrast.gain * T)
    good = tukey(left / (WIDTH * spread(left, chip.use)), chip.use)[0] > SEEN
    whitener = Whitener.of(left, good)
    # what is left out stays out: a changed field must not leak into its neighbours
    seen = whitener.reach(good).astype(np.float64) if whitener.acts else chip.use

    def both(values: Array) -> Array:
        return whitener(contrast(values))

    return _with_slopes(Round(template, chip, look, contrast, both, seen, chip.x, 0.0), state, T)


def _exact(look: Look, chip: Pixels) -> bool:
    """Whether no more is left than what comes of interpolating between the template's samples."""
    level = float(np.median(chip.window[chip.use > 0.0]))
    return spread(look.residual, chip.use) < _EXACT * spread(chip.window - level, chip.use)


def _as_it_is(values: Array) -> Array:
    return values


def _with_slopes(held: Round, state: State, T: Array) -> Round:
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


def _places(chip: Pixels, state: State) -> tuple[Array, Array]:
    """Where in the template the pixels lie."""
    d, B = state.d, state.B
    x = d[0] + (1.0 + B[0, 0]) * chip.x + B[0, 1] * chip.y
    return x, d[1] + B[1, 0] * chip.x + (1.0 + B[1, 1]) * chip.y


def settled(held: Round, state: State, start: Array, rest_px: float) -> State | None:
    """The state at which the steps come to rest; None where they do not, or leave what is possible."""
    for k in range(STEPS):
        state = _step(held, state, rest_px, k > 0)
        if np.hypot(*(state.d - start)) > REACH_PX or np.abs(state.B).max() > MOST_SHAPE:
            return None
        if state.done:
            return state
    return None


def prior_of(s2: float) -> Array:
    """Weights (8,) of no distortion, g = 1 and o = 0."""
    return s2 * np.array([0.0, 0.0, *[SHAPE**-2] * 4, _HELD, _HELD])


def _step(held: Round, state: State, rest_px: float, may_rest: bool) -> State:
    """One Gauss-Newton step."""
    r = held.filtered(held.chip.window - held.model(state))
    w, curvature = tukey(r / (WIDTH * spread(r, held.seen)), held.seen)
    flat = held.J.reshape(-1, 8)
    s2 = float(np.sum(w * r**2)) / max(float(w.sum()) - 8.0, 1.0)
    prior, weighted = prior_of(s2), (flat * w.reshape(-1, 1)).mT
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
    return State(d, B, state.gain + step[6], offset, r, w, curvature, float(np.sqrt(s2)), N, rest)
