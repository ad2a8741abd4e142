"""A mounting that moves as SPICE kernels: a C-kernel (type 3) of the camera relative to its tracker, and its clock.

The clock is one of its own, that of no spacecraft: ticks of 0.1 ms of TDB since 1950, so that no other kernel's clock
is in its way.  Sources: NAIF, CK Required Reading and SCLK Required Reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ...physics.errors import InputError
from .series_tables import EpochArray, FloatArray
from .spice import loaded, spiceypy_module, tdb_seconds
from .spice_names import frame_name

TICKS_PER_SECOND = 10_000
START_TDB_S = -1_577_880_000
"""TDB of the clock's zero, 1950."""
COUNTS = 2**32


def clock_id(camera_id: int) -> int:
    """The id of the clock that belongs to a camera's frame."""
    return -abs(camera_id)


def clock_kernel_text(camera_id: int) -> str:
    """The clock as a text kernel (SCLK, type 1)."""
    n = abs(camera_id)
    values = {
        f"SCLK_DATA_TYPE_{n}": "1",
        f"SCLK01_TIME_SYSTEM_{n}": "1",
        f"SCLK01_N_FIELDS_{n}": "2",
        f"SCLK01_MODULI_{n}": f"{COUNTS} {TICKS_PER_SECOND}",
        f"SCLK01_OFFSETS_{n}": "0 0",
        f"SCLK01_OUTPUT_DELIM_{n}": "1",
        f"SCLK_PARTITION_START_{n}": "0.0",
        f"SCLK_PARTITION_END_{n}": f"{COUNTS * TICKS_PER_SECOND - 1}.0",
        f"SCLK01_COEFFICIENTS_{n}": f"0.0 {START_TDB_S}.0 1.0",
    }
    data = [f"{name} = ( {value} )" for name, value in values.items()]
    prose = "   Clock of mounting.bc, written by starplumb: ticks of 0.1 ms of TDB since 1950."
    return "\n".join(["KPL/SCLK", "", prose, "", "\\begindata", "", *data, "", "\\begintext", ""])


def write_ck(
    path: Path,
    kernels: Sequence[str],
    frames: tuple[str, str],
    camera_id: int,
    t_ns: EpochArray,
    C_EK: FloatArray,
    starts: EpochArray,
) -> None:
    """Write mountings C_EK (n, 3, 3) at epochs (n,) as a C-kernel, linear between them but not across ``starts``.

    ``kernels`` are the texts of the frame kernel and the clock, ``frames`` the names of camera and tracker.  Raises
    InputError where spiceypy is not installed or the frame kernel does not define the tracker.
    """
    spice = spiceypy_module()
    ticks = (tdb_seconds(t_ns) - START_TDB_S) * TICKS_PER_SECOND
    quaternions = np.array([spice.m2q(C) for C in np.ascontiguousarray(C_EK.mT)])
    with TemporaryDirectory() as folder:
        files = [Path(folder) / f"{i}.tf" for i in range(len(kernels))]
        for file, text in zip(files, kernels, strict=True):
            file.write_text(text, encoding="ascii", newline="\n")
        with ExitStack() as loading:
            for file in files:
                loading.enter_context(loaded(spice, path, file))
            written = Path(folder) / "mounting.bc"
            tracker = frame_name(frames[1])
            if spice.namfrm(tracker) == 0:
                raise InputError(f"{path}: the frame {tracker} is not defined here, wanted spice.tracker.id")
            handle = spice.ckopn(str(written), "mounting", 0)
            begins = np.interp(starts, t_ns, ticks)
            spice.ckw03(
                *(handle, ticks[0], ticks[-1], camera_id, tracker, False, "mounting by starplumb"),
                *(ticks.size, ticks, quaternions, np.zeros((ticks.size, 3)), begins.size, begins),
            )
            spice.ckcls(handle)
            content = written.read_bytes()
    path.write_bytes(content)
