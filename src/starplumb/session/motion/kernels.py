"""The files of a mounting that moves: a table with its covariance, and a SPICE C-kernel where spiceypy is there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...disk.publish import Content
from ...io.text.write import csv_text
from ...judge.motion.asked import NONE
from ...judge.motion.regressors import ORBIT, STEP, TEMPERATURE, When
from ...physics import so3
from ...physics.timescales import format_iso, parse
from ...physics.units import ARCSEC

if TYPE_CHECKING:
    from ...io.formats.spice_names import FrameIds
    from ...judge.calibrate import Calibration
    from ...judge.motion.averaging import Motion

Array = NDArray[np.float64]
Epochs = NDArray[np.int64]
KernelFrames = tuple[str, str, "FrameIds"]

TABLE, CK, CLOCK = "mounting.csv", "mounting.bc", "mounting.tsc"
MOVING_FILES = (TABLE, CK, CLOCK)
A_TURN = 60
"""Samples an orbit: between them a sine is linear to 0.15 % of its amplitude."""
MOST = 20_000
"""Samples of the whole span; of a longer one those around the images, half an orbit to either side."""
SIDE_NS = 500_000_000
"""Samples before and after a step."""


@dataclass(frozen=True)
class MovingKernels:
    """Texts of the files, and what the C-kernel is written from; ``kernel`` gives ``mounting.tf`` by a clock's id."""

    t_ns: Epochs
    C_EK: Array
    covariance_E: Array
    starts: Epochs
    frames: KernelFrames
    kernel: Callable[[int], str]

    @property
    def clock(self) -> int | None:
        """The id of the kernel's clock; None where no C-kernel can be written."""
        if find_spec("spiceypy") is None or self.frames[2].tracker is None:
            return None
        from ...io.formats.spice_ck import clock_id

        return clock_id(self.frames[2].camera)

    @property
    def files(self) -> Mapping[str, Content]:
        """The table, and the kernels where they can be written."""
        return self.texts if self.clock is None else {**self.texts, CK: self.write_ck}

    @property
    def texts(self) -> dict[str, str]:
        """The table, and the texts of the kernels."""
        rows, columns = np.triu_indices(3)
        entries = self.covariance_E[:, rows, columns] / ARCSEC**2
        names = [f"covariance_{'xyz'[i]}{'xyz'[j]}_arcsec2" for i, j in zip(rows, columns, strict=True)]
        header = ["time", "qx", "qy", "qz", "qw", *names]
        values = [format_iso(self.t_ns, "UTC"), *so3.to_quaternion(self.C_EK).T, *entries.T]
        texts = {TABLE: csv_text(header, values)}
        if (clock := self.clock) is not None:
            from ...io.formats.spice_ck import clock_kernel_text

            texts |= {CLOCK: clock_kernel_text(self.frames[2].camera), "mounting.tf": self.kernel(clock)}
        return texts

    def write_ck(self, path: Path) -> None:
        """Write the C-kernel."""
        from ...io.formats.spice_ck import write_ck

        camera, tracker, ids = self.frames
        texts = [self.texts["mounting.tf"], self.texts[CLOCK]]
        write_ck(path, texts, (camera, tracker), ids.camera, self.t_ns, self.C_EK, self.starts)


def moving_kernels(
    c: Calibration, kernel: Callable[[int], str], frames: KernelFrames
) -> MovingKernels | None:
    """Of an answer whose motion was estimated; None for one that rests."""
    if c.moves is None or c.moves.asked == NONE or c.moves.motion is None or len(c.moves.motion.names) < 2:
        return None
    motion = c.moves.motion
    when, starts = _sampled(motion, c.moves.when)
    turn, covariance = motion.at(when)
    return MovingKernels(when.t_ns, so3.exp(turn) @ c.estimate.C_EK, covariance, starts, frames, kernel)


def _sampled(motion: Motion, images: When) -> tuple[When, Epochs]:
    """Epochs of the samples, and those at which an interval of them begins."""
    first, last = motion.scales.first_ns, motion.scales.last_ns
    orbit = motion.scales.orbit
    if any(name.startswith(TEMPERATURE) for name in motion.names):  # known at the images only
        order = np.unique(images.t_ns, return_index=True)[1]
        kept = {name: values[order] for name, values in images.temperatures.items()}
        return When(images.t_ns[order], images.u[order], kept), images.t_ns[order]
    t_ns = np.array([first, last], dtype=np.int64)
    starts = t_ns[:1]
    if orbit is not None and any(name.startswith(ORBIT) for name in motion.names):
        t_ns, starts = _around(images.t_ns, round(2e9 * np.pi / orbit.rate))
    steps = [int(parse([name.partition(":")[2]], "UTC")[0]) for name in motion.names if name.startswith(STEP)]
    sides = [step + side for step in steps for side in (-SIDE_NS, SIDE_NS) if first < step + side < last]
    inside = np.unique(np.concatenate([t_ns, np.array(sides, dtype=np.int64)]))
    u = np.zeros(inside.size) if orbit is None else orbit.at(inside)
    return When(inside, u), starts


def _around(images: Epochs, period_ns: int) -> tuple[Epochs, Epochs]:
    """Samples of the whole span of images, or around each of them, and where intervals of them begin."""
    step = period_ns // A_TURN
    count = np.unique((images - images.min()) // step)
    if (images.max() - images.min()) // step + 2 <= MOST:
        count = np.arange((images.max() - images.min()) // step + 1)
    else:
        side = np.arange(-A_TURN // 2, A_TURN // 2 + 1)
        count = np.unique((count[:, None] + side).reshape(-1))
    t_ns = images.min() + step * count
    begins = np.flatnonzero(np.diff(t_ns, prepend=t_ns[0] - 2 * step) > step)
    t_ns = np.append(t_ns, images.max()) if t_ns[-1] < images.max() else t_ns
    return t_ns, t_ns[begins]
