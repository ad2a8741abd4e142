"""What readers of standard ephemeris and attitude files return: frozen tables, nothing interpolated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..text.frames import earth_frame

FloatArray = npt.NDArray[np.float64]
EpochArray = npt.NDArray[np.int64]
Rows = tuple[int, int]


@dataclass(frozen=True)
class EphemerisTable:
    """Positions of one object relative to the Earth's centre, in the frame the file names.

    ``t_ns`` (n,) strictly increasing; ``r`` (n, 3) m; ``v`` (n, 3) m/s or None (relative to the turning Earth
    where ``frame`` is ITRF). ``frame`` is "ITRF", "GCRF", "TEME", "TOD" or "MOD",
    ``frame_text`` the file's own word for it.
    ``segments`` are the rows [start, stop) of each arc: do not interpolate from one into the next.
    ``notices`` are sentences for the user about whatever was left out.
    """

    t_ns: EpochArray
    r: FloatArray
    v: FloatArray | None
    frame: str
    time_scale: str
    object_name: str
    segments: tuple[Rows, ...]
    frame_text: str = ""
    object_id: str = ""
    notices: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check_rows(self.t_ns, self.segments)
        if self.r.shape != (len(self.t_ns), 3) or (self.v is not None and self.v.shape != self.r.shape):
            raise ValueError("r and v must be (n, 3) beside t_ns (n,)")
        if earth_frame(self.frame) != self.frame:
            raise ValueError(f"frame is ITRF, GCRF, TEME, TOD or MOD, not {self.frame}")


@dataclass(frozen=True)
class AttitudeTable:
    """Quaternions of C_BA, "B from A": v_B = C_BA v_A.

    ``t_ns`` (n,) strictly increasing; ``q_BA_xyzw`` (n, 4) of unit norm, scalar last, Hamilton (the
    quaternion that rotates v_A into v_B). ``frame_a`` and ``frame_b`` are the file's own words. ``segments``
    and ``notices`` as in :class:`EphemerisTable`.
    """

    t_ns: EpochArray
    q_BA_xyzw: FloatArray
    frame_a: str
    frame_b: str
    time_scale: str
    object_name: str
    segments: tuple[Rows, ...]
    object_id: str = ""
    notices: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check_rows(self.t_ns, self.segments)
        if self.q_BA_xyzw.shape != (len(self.t_ns), 4):
            raise ValueError("q_BA_xyzw must be (n, 4) beside t_ns (n,)")


def _check_rows(t_ns: EpochArray, segments: tuple[Rows, ...]) -> None:
    if t_ns.ndim != 1 or not np.all(np.diff(t_ns) > 0):
        raise ValueError("t_ns must be (n,) and strictly increasing")
    borders = [0, *(stop for _, stop in segments)]
    if [start for start, _ in segments] != borders[:-1] or borders[-1] != len(t_ns):
        raise ValueError("segments must cover all rows in order")
