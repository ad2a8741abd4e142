"""What a mounting may move with: columns of numbers, one an image or a time, by name.

=========================== ==========================================================================================
``mean``                    1
``linear``                  time after the middle of the images over their span, -1/2 .. 1/2
``step:TIME``               -1/2 before and +1/2 after the time (UTC)
``orbit:K cos``, ``sin``    harmonic K of the argument of latitude
``temperature:NAME``        temperature of the column over half its range among the images, about the middle of it
=========================== ==========================================================================================
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...physics.timescales import format_iso, parse
from ...table.phases import OrbitPhase

Array = NDArray[np.float64]
Epochs = NDArray[np.int64]

MEAN, LINEAR, STEP, ORBIT, TEMPERATURE = "mean", "linear", "step", "orbit", "temperature"
HARMONICS = 3
"""Harmonics of the argument of latitude that are tested."""
MOST_STEPS = 40
"""Gaps between images in which a step is looked for; of more some, spread evenly over the images."""
EITHER_SIDE = 2
"""Images before and after a step at least."""
MORE_IMAGES = 3
"""Images at least beyond the number of columns besides the constant."""
TOLD_APART = 0.1
"""Smallest singular value, per root of the number of images, of columns that images tell apart from one another and
from a constant: phases on less than 110 degrees of the orbit do not tell a sine from a parabola."""


@dataclass(frozen=True)
class When:
    """Images (m,) by what a mounting may move with: ``t_ns``, argument of latitude ``u`` (rad), ``temperatures`` by
    name (deg C)."""

    t_ns: Epochs
    u: Array
    temperatures: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Scales:
    """From what columns are counted: the first and last time of the images, their orbit's even motion (None where it
    has none), middle and half range of each temperature, and the times of steps by their names."""

    first_ns: int
    last_ns: int
    orbit: OrbitPhase | None
    temperatures: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    steps: Mapping[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, when: When, orbit: OrbitPhase | None) -> Scales:
        ends = {
            name: (float(values.min()), float(values.max())) for name, values in when.temperatures.items()
        }
        scales = {name: ((low + high) / 2.0, (high - low) / 2.0) for name, (low, high) in ends.items()}
        return cls(int(when.t_ns.min()), int(when.t_ns.max()), orbit, scales, steps_of(when.t_ns))

    @property
    def span_ns(self) -> int:
        return self.last_ns - self.first_ns

    def column(self, name: str, when: When) -> Array:
        """The column (m,) of that name."""
        kind, _, which = name.partition(":")
        if kind == MEAN:
            return np.ones(when.t_ns.size)
        if kind == LINEAR:
            return np.asarray((when.t_ns - self.first_ns) / max(self.span_ns, 1) - 0.5)
        if kind == STEP:
            at = self.steps[name] if name in self.steps else int(parse([which], "UTC")[0])
            return np.where(when.t_ns > at, 0.5, -0.5)
        if kind == TEMPERATURE:
            middle, half = self.temperatures[which]
            return (when.temperatures[which] - middle) / half
        k, _, phase = which.partition(" ")
        return np.asarray((np.cos if phase == "cos" else np.sin)(int(k) * when.u))

    def columns(self, names: Sequence[str], when: When) -> Array:
        """Columns side by side, (m, q)."""
        return np.stack([self.column(name, when) for name in names], axis=-1)


def harmonics(upto: int) -> tuple[str, ...]:
    """Names of the columns of the first harmonics."""
    return tuple(f"{ORBIT}:{k} {phase}" for k in range(1, upto + 1) for phase in ("cos", "sin"))


def steps_of(t_ns: Epochs) -> dict[str, int]:
    """Steps in the middle of gaps between images (m,) that have some images on either side, and their times."""
    t = np.sort(t_ns)
    after = np.arange(EITHER_SIDE, t.size - EITHER_SIDE + 1)
    after = after[np.diff(t)[after - 1] > 2 * 10**9] if t.size > 1 else after[:0]
    if after.size > MOST_STEPS:
        after = after[np.linspace(0, after.size - 1, MOST_STEPS).astype(np.int64)]
    middle = t[after - 1] + (t[after] - t[after - 1]) // 2
    times = format_iso(middle, "UTC", 0)
    return {f"{STEP}:{time}": int(at) for time, at in zip(times, parse(times, "UTC"), strict=True)}


def families(when: When, scales: Scales) -> dict[str, tuple[tuple[str, ...], ...]]:
    """What can be tested on images: by name alternatives of the same number of columns, one of them or more."""
    tried: dict[str, tuple[tuple[str, ...], ...]] = {LINEAR: ((LINEAR,),)}
    if scales.steps:
        tried[STEP] = tuple((name,) for name in scales.steps)
    if scales.orbit is not None:
        tried |= {f"{ORBIT}:{k}": (harmonics(k),) for k in range(1, HARMONICS + 1)}
    tried |= {
        f"{TEMPERATURE}:{name}": ((f"{TEMPERATURE}:{name}",),)
        for name, (_, half) in scales.temperatures.items()
        if half > 0.0
    }
    found = {}
    for name, sets in tried.items():
        good = told_apart(np.stack([scales.columns((MEAN, *names), when) for names in sets]))
        if np.any(good):
            found[name] = tuple(names for names, told in zip(sets, good.tolist(), strict=True) if told)
    return found


def told_apart(F: Array) -> NDArray[np.bool_]:
    """Whether (...) images tell the columns F (..., m, q) apart: there are enough of them, and no combination nearly
    vanishes."""
    m, q = F.shape[-2:]
    if m < q - 1 + MORE_IMAGES:
        return np.zeros(F.shape[:-2], dtype=np.bool_)
    own = F / np.maximum(np.max(np.abs(F), axis=-2, keepdims=True), 1e-300)
    return np.asarray(np.linalg.svd(own, compute_uv=False)[..., -1] > TOLD_APART * np.sqrt(m))
