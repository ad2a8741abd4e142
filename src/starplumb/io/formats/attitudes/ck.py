"""Attitude from a SPICE C-kernel, with the kernels of the satellite's clock (SCLK) and its frames (FK), by spiceypy.

A C-kernel gives the matrix that takes coordinates from a reference frame to those of a structure; its quaternion,
scalar first, is of that matrix in Hamilton's sense, which is ours.  Discrete pointing (types 1 and 3) is read sample by
sample, so that nothing is interpolated twice; other types are sampled.  Source: NAIF, CK, SCLK and Frames Required
Reading.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import numpy as np

from ....physics import so3
from ....physics.errors import InputError
from ...text.files import read_beginning, show, unpacked_file
from ..quaternions import unit
from ..series_tables import AttitudeTable, EpochArray, FloatArray
from ..spice import loaded, spiceypy_module, t_ns_of_tdb

CK_START = "DAF/CK"
_DISCRETE = (1, 3)
_STEP_S = 0.1
_MOST_TDB_S = 6e9
_MOST_SAMPLES = 1_000_000
_CK_FRAME, _TK_FRAME = 3, 4
_MOST_TURNS = 8
_EARTH_FIXED = "ITRF93"


@dataclass(frozen=True)
class _Segment:
    """Samples of one segment: quaternions of C_BA at ``t_ns`` (n,), the first of each stretch in ``starts``."""

    t_ns: EpochArray
    q_BA: FloatArray
    starts: tuple[int, ...]
    reference: str


def read_ck(path: Path, kernels: Sequence[Path], target: str = "") -> AttitudeTable:
    """Attitude of the frame ``target`` by a C-kernel; ``kernels`` are its SCLK and, where frames have names, FK.

    ``target`` may be fixed to the structure that the kernel has (a frame of FK); where no kernel knows it, there must
    be one structure only, which is then taken for it.  Raises InputError for what cannot be used.
    """
    spice = spiceypy_module()
    with ExitStack() as stack:
        for kernel in kernels:
            _require_one_kernel(kernel)
            stack.enter_context(loaded(spice, kernel, kernel))
        plain = stack.enter_context(unpacked_file(path))
        stack.enter_context(loaded(spice, path, plain))
        structure, C_TB, notices = _structure(spice, path, plain, target)
        clock = _clock(spice, path, structure)
        handle = spice.dafopr(str(plain))
        stack.callback(spice.dafcls, handle)
        segments = _segments(spice, handle, structure)
        found = [_read(spice, path, handle, segment, clock) for segment in segments]
        frame, found = _one_reference(spice, path, found)
    t_ns, q_BA, borders = _joined(path, found)
    q_TA = so3.to_quaternion(C_TB @ so3.from_quaternion(q_BA)) if C_TB is not None else q_BA
    return AttitudeTable(
        t_ns,
        q_BA_xyzw=q_TA,
        frame_a=frame,
        frame_b=target if not notices else "",
        time_scale="TAI",
        object_name=str(structure),
        segments=tuple(pairwise(borders)),
        notices=tuple(notices),
    )


def _require_one_kernel(kernel: Path) -> None:
    """A kernel that loads others would read files that nobody named."""
    if re.search(rb"KERNELS_TO_LOAD", read_beginning(kernel)):
        found = "found a meta-kernel, which names other kernels"
        raise InputError(f"{kernel}: {found}, wanted the kernels themselves in attitude.kernels")


def _structure(
    spice: ModuleType, path: Path, plain: Path, target: str
) -> tuple[int, FloatArray | None, list[str]]:
    """The structure whose pointing leads to ``target``, and the fixed rotation from it where there is one."""
    there = sorted(spice.ckobj(str(plain)))
    frame_id = int(spice.namfrm(target)) if target else 0
    if frame_id:
        structure, C = _down_to_ck(spice, path, target, frame_id)
        if structure not in there:
            found = f"found the structures {', '.join(map(str, there))}"
            raise InputError(f"{path}: {found}, wanted {structure}, on which {show(target)} stands")
        return structure, C, []
    if len(there) != 1:
        found = f"found {len(there)} structures ({', '.join(map(str, there))}) and no kernel that knows {show(target)}"
        raise InputError(f"{path}: {found}, wanted its frame kernel (FK) in attitude.kernels")
    return there[0], None, [f"{path}: took its structure {there[0]} for {target}, the name in the campaign"]


def _down_to_ck(spice: ModuleType, path: Path, target: str, frame_id: int) -> tuple[int, FloatArray | None]:
    """From a frame through those that it is fixed to, down to one whose attitude a C-kernel has."""
    C: FloatArray | None = None
    for _ in range(_MOST_TURNS):
        _, kind, class_id = spice.frinfo(frame_id)
        if kind == _CK_FRAME:
            return int(class_id), C
        if kind != _TK_FRAME:
            break
        matrix, frame_id = spice.tkfram(frame_id)
        # tkfram goes from the fixed frame to the one below it
        step = np.asarray(matrix).mT
        C = step if C is None else C @ step
    found = f"found {show(target)} to be no frame of a C-kernel, nor fixed to one"
    raise InputError(f"{path}: {found}, wanted a frame that the attitude leads to")


def _clock(spice: ModuleType, path: Path, structure: int) -> int:
    """The clock that the structure's times are of, which must have been loaded."""
    clock = int(spice.ckmeta(structure, "SCLK"))
    if not spice.expool(f"SCLK_DATA_TYPE_{-clock}"):
        raise InputError(
            f"{path}: found no kernel of the clock {clock}, wanted it (SCLK, .tsc) in attitude.kernels"
        )
    return clock


def _segments(spice: ModuleType, handle: int, structure: int) -> list[tuple[FloatArray, FloatArray]]:
    """Clock ticks and integers of the descriptor of each segment of the structure.

    All at once: SPICE's own look-ups in the same file begin the search anew.
    """
    found = []
    spice.dafbfs(handle)
    while spice.daffna():
        ticks, whole = spice.dafus(spice.dafgs(5), 2, 6)
        if int(whole[0]) == structure:
            found.append((np.asarray(ticks), np.asarray(whole)))
    return found


def _read(
    spice: ModuleType, path: Path, handle: int, segment: tuple[FloatArray, FloatArray], clock: int
) -> _Segment:
    ends, whole = segment
    _, reference, kind, with_rates, first, last = (int(value) for value in whole)
    name = str(spice.frmnam(reference))
    if kind not in _DISCRETE:
        return _sampled(spice, path, int(whole[0]), ends, clock, name)
    width = 7 if with_rates else 4
    tail = 2 if kind == 3 else 1
    counts = [int(value) for value in spice.dafgda(handle, last - tail + 1, last)]
    n = counts[-1]
    data = np.asarray(spice.dafgda(handle, first, first + n * (width + 1) - 1))
    quaternions, ticks = data[: n * width].reshape(n, width)[:, :4], data[n * width :]
    starts = (0,)
    if kind == 3:
        at = first + n * (width + 1) + (n - 1) // 100
        begins = np.asarray(spice.dafgda(handle, at, at + counts[0] - 1))
        starts = tuple(np.searchsorted(ticks, begins).tolist())
    q = unit(
        np.roll(quaternions, -1, axis=1), lambda row, fault: InputError(f"{path}, sample {row + 1}: {fault}")
    )
    return _Segment(_epochs(spice, path, clock, ticks), q, starts, name)


def _sampled(
    spice: ModuleType, path: Path, structure: int, ends: FloatArray, clock: int, reference: str
) -> _Segment:
    """A segment that is no list of samples, at most a tenth of a second apart; what it has no attitude for parts it."""
    first, last = _of_an_age(path, np.array([spice.sct2e(clock, float(tick)) for tick in ends])).tolist()
    n = int(np.ceil((last - first) / _STEP_S - 1e-6)) + 1
    if not 1 <= n <= _MOST_SAMPLES:
        raise InputError(
            f"{path}: found a segment of {last - first:.6g} s, wanted one of {_MOST_SAMPLES * _STEP_S:g} s"
        )
    ticks = np.clip([spice.sce2c(clock, float(value)) for value in np.linspace(first, last, n)], *ends)
    with spice.no_found_check():
        answers = [spice.ckgp(structure, float(tick), 0.0, reference) for tick in ticks]
    there = np.array([bool(found) for *_, found in answers])
    if not there.any():
        raise InputError(f"{path}: found a segment without attitudes, wanted at least one")
    matrices = np.array([answer[0] for answer in answers])[there]
    starts = np.cumsum(there)[there & ~np.roll(there, 1)] - 1
    return _Segment(
        _epochs(spice, path, clock, ticks[there]),
        so3.to_quaternion(matrices),
        tuple(sorted({0, *starts.tolist()})),
        reference,
    )


def _epochs(spice: ModuleType, path: Path, clock: int, ticks: FloatArray) -> EpochArray:
    return t_ns_of_tdb(_of_an_age(path, np.array([spice.sct2e(clock, float(tick)) for tick in ticks])))


def _of_an_age(path: Path, seconds: FloatArray) -> FloatArray:
    """Times that nanoseconds can count.  Raises InputError for others, as a wrong clock gives."""
    if not (np.abs(seconds) < _MOST_TDB_S).all():
        raise InputError(
            f"{path}: found times that its clock puts centuries away, wanted the clock of this kernel"
        )
    return seconds


def _one_reference(spice: ModuleType, path: Path, found: list[_Segment]) -> tuple[str, list[_Segment]]:
    """The reference frame by our name, and the segments turned into it where theirs is another inertial one."""
    names = {segment.reference for segment in found}
    if names == {_EARTH_FIXED}:
        return "ITRF", found
    turned = []
    for segment in found:
        _, kind, _ = spice.frinfo(spice.namfrm(segment.reference))
        if kind != 1:
            wanted = f"J2000, another inertial frame, or {_EARTH_FIXED} throughout"
            raise InputError(f"{path}: found the reference frame {show(segment.reference)}, wanted {wanted}")
        C = np.asarray(spice.pxform("J2000", segment.reference, 0.0))
        q = (
            segment.q_BA
            if segment.reference == "J2000"
            else so3.to_quaternion(so3.from_quaternion(segment.q_BA) @ C)
        )
        turned.append(_Segment(segment.t_ns, q, segment.starts, "J2000"))
    return "GCRF", turned


def _joined(path: Path, found: list[_Segment]) -> tuple[EpochArray, FloatArray, list[int]]:
    """All samples in order of time, and the rows at which stretches begin."""
    ordered = sorted(found, key=lambda segment: int(segment.t_ns[0]))
    borders, rows = [], 0
    for segment in ordered:
        borders += [rows + start for start in segment.starts]
        rows += len(segment.t_ns)
    t_ns = np.concatenate([segment.t_ns for segment in ordered])
    if np.any(np.diff(t_ns) <= 0):
        raise InputError(f"{path}: found segments that overlap in time, wanted one attitude at a time")
    return t_ns, np.concatenate([segment.q_BA for segment in ordered]), [*borders, rows]
