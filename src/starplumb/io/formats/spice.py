"""SPICE kernels: orbits read from an SPK by way of spiceypy, the mounting written as a text frame kernel."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...physics import timescales
from ...physics.errors import InputError
from ...physics.units import ARCSEC
from ..text.files import read_beginning, trouble, unpacked_file
from .series_tables import EphemerisTable, EpochArray, FloatArray
from .spice_names import DEFAULT_IDS, FrameIds, frame_name

_TT_MINUS_TAI_NS = 32_184_000_000
_MOST_TDB_S = 6e9
_MOST_SAMPLES = 5_000_000
"""A year and a half every 10 s."""
_MOST_REASON = 300
"""Letters of what SPICE says."""
_AT_ONCE = 50_000
"""States asked for together: SPICE gives each as an object of its own."""
_SPK_STARTS = (b"DAF/SPK", b"NAIF/DAF")


def tdb_seconds(t_ns: npt.ArrayLike) -> FloatArray:
    """SPICE's ephemeris time of epochs ``t_ns`` (n,): TDB seconds since J2000 TDB.

    TDB = TT + K sin E, E = M + e sin M, M = M0 + M1 t, with the constants of NAIF's leap-second kernels. It
    is within 0.03 ms of the complete series; it is used because kernels are written with it, so that their
    own times come back.
    """
    tt = (np.asarray(t_ns, dtype=np.int64) + _TT_MINUS_TAI_NS) * 1e-9
    anomaly = 6.239996 + 1.99096871e-7 * tt
    return np.asarray(tt + 1.657e-3 * np.sin(anomaly + 1.671e-2 * np.sin(anomaly)))


class _Span(NamedTuple):
    """An interval to sample, and the kernel's own interval around it in TDB seconds."""

    start_ns: int
    stop_ns: int
    first_tdb: float
    last_tdb: float


def _span(first_tdb: float, last_tdb: float) -> _Span:
    """Whole microseconds inside an interval of coverage; 0.2 us beyond, a rounding of TDB, is inside."""
    start = int(np.ceil(_tt_of_tdb(first_tdb) * 1e6 - 0.2)) * 1000
    stop = int(np.floor(_tt_of_tdb(last_tdb) * 1e6 + 0.2)) * 1000
    return _Span(start - _TT_MINUS_TAI_NS, stop - _TT_MINUS_TAI_NS, first_tdb, last_tdb)


def _tt_of_tdb(seconds: float) -> float:
    """Seconds of TT since J2000 at a time in TDB."""
    return float((t_ns_of_tdb(np.array([seconds]))[0] + _TT_MINUS_TAI_NS) * 1e-9)


def t_ns_of_tdb(seconds: FloatArray) -> EpochArray:
    """Epochs (n,) of SPICE's ephemeris times: inverse of :func:`tdb_seconds`, by an iteration that gains ten digits a
    step."""
    tt = seconds
    for _ in range(2):
        tt = tt + (seconds - tdb_seconds(np.rint(tt * 1e9).astype(np.int64) - _TT_MINUS_TAI_NS))
    return np.rint(tt * 1e9).astype(np.int64) - _TT_MINUS_TAI_NS


def read_spk(
    path: str | Path,
    step_s: float = 10.0,
    start_ns: int | None = None,
    stop_ns: int | None = None,
    target: int | None = None,
) -> EphemerisTable:
    """Geocentric states of one body in a SPICE SPK, sampled every ``step_s`` seconds.

    The part of [``start_ns``, ``stop_ns``] (everything where None) that the kernel covers is sampled.
    Frame J2000 of SPICE, which is the GCRF; m and m/s. Each interval of coverage is a segment and its end is
    sampled as well. ``target`` (NAIF ID) may be left out where the file holds one body only. Raises
    InputError where spiceypy is not installed, the file is no SPK, several bodies are there and none is
    named, or nothing lies in the span.
    """
    if not step_s > 0:
        raise InputError(f"{path}: the sampling step is {step_s} s, wanted more than 0")
    spice = spiceypy_module()
    _check_kind(path)
    with unpacked_file(Path(path)) as kernel, loaded(spice, path, kernel):
        body = _target(path, sorted(spice.spkobj(str(kernel))), target)
        spans = _spans(path, spice.spkcov(str(kernel), body), start_ns, stop_ns)
        _require_few(path, spans, step_s)
        epochs = [_samples(span, step_s) for span in spans]
        tdb = np.concatenate([_tdb(span, t_ns) for span, t_ns in zip(spans, epochs, strict=True)])
        states = np.empty((tdb.size, 6))
        for at in range(0, tdb.size, _AT_ONCE):
            part = slice(at, at + _AT_ONCE)
            states[part] = spice.spkezr(str(body), tdb[part], "J2000", "NONE", "EARTH")[0]
        states *= 1e3
    borders = np.cumsum([0, *map(len, epochs)]).tolist()
    return EphemerisTable(
        np.concatenate(epochs),
        r=states[:, :3],
        v=states[:, 3:],
        frame="GCRF",
        time_scale="TAI",
        object_name=str(body),
        segments=tuple(pairwise(borders)),
        frame_text="J2000",
        object_id=str(body),
    )


def spiceypy_module() -> ModuleType:
    """spiceypy; InputError where it is not installed."""
    try:
        import spiceypy
    except ImportError:
        raise InputError('SPICE kernels need spiceypy: pip install "starplumb[spice]"') from None
    module: ModuleType = spiceypy
    return module


@contextmanager
def loaded(spice: ModuleType, path: str | Path, kernel: Path) -> Iterator[None]:
    """Load the kernel of the user's file ``path``, and unload it afterwards; errors of SPICE become InputError."""
    if read_beginning(kernel).startswith(b"DAF/"):
        from .kernels.daf import require_whole

        require_whole(Path(path), kernel)
    try:
        spice.furnsh(str(kernel))
        try:
            yield
        finally:
            spice.unload(str(kernel))
    except spice.utils.exceptions.SpiceyError as error:
        reason = " ".join(f"{getattr(error, 'short', '')} {getattr(error, 'long', error)}".split())
        reason = reason if len(reason) <= _MOST_REASON else f"{reason[:_MOST_REASON]} ..."
        raise InputError(f"{path}: SPICE cannot use this kernel: {reason}") from None


def is_spk(start: bytes) -> bool:
    """Whether a file that begins with ``start`` is a SPICE kernel of orbits."""
    return start.startswith(_SPK_STARTS)


def _check_kind(path: str | Path) -> None:
    if (found := trouble(Path(path))) is not None:
        raise InputError(f"{path}: {found}")
    if not is_spk(read_beginning(Path(path))):
        raise InputError(f"{path}: is not a SPICE SPK, which begins with DAF/SPK")


def _target(path: str | Path, bodies: list[int], target: int | None) -> int:
    listed = ", ".join(map(str, bodies))
    if target is not None and target not in bodies:
        raise InputError(f"{path}: holds no body {target}, name one of {listed}")
    if target is None and len(bodies) != 1:
        raise InputError(f"{path}: holds {len(bodies)} bodies, name one of {listed}")
    return bodies[0] if target is None else target


def _spans(
    path: str | Path, coverage: Sequence[float], start_ns: int | None, stop_ns: int | None
) -> list[_Span]:
    """Intervals of coverage (TDB seconds, flat pairs), cut to the span asked for."""
    ends = [float(end) for end in coverage]
    if not ends or max(map(abs, ends)) > _MOST_TDB_S:
        raise InputError(
            f"{path}: found no coverage, or one far from now, wanted it within {_MOST_TDB_S:g} s of 2000"
        )
    covered = [_span(first, last) for first, last in zip(ends[::2], ends[1::2], strict=True)]
    start = covered[0].start_ns if start_ns is None else start_ns
    stop = covered[-1].stop_ns if stop_ns is None else stop_ns
    cut = [
        span._replace(start_ns=max(span.start_ns, start), stop_ns=min(span.stop_ns, stop)) for span in covered
    ]
    spans = [span for span in cut if span.start_ns < span.stop_ns]
    if not spans:
        wanted = timescales.format_iso([start, stop], "TAI", digits=3)
        found = timescales.format_iso([covered[0].start_ns, covered[-1].stop_ns], "TAI", digits=3)
        fault = f"nothing lies in {wanted[0]} .. {wanted[1]} TAI"
        raise InputError(f"{path}: {fault}, the kernel covers {found[0]} .. {found[1]} TAI")
    return spans


def _require_few(path: str | Path, spans: list[_Span], step_s: float) -> None:
    n = sum((span.stop_ns - span.start_ns) / (step_s * 1e9) for span in spans)
    if n > _MOST_SAMPLES:
        days = sum(span.stop_ns - span.start_ns for span in spans) / 86400e9
        raise InputError(
            f"{path}: found {days:.0f} days every {step_s:g} s, wanted at most {_MOST_SAMPLES} samples"
        )


def _samples(span: _Span, step_s: float) -> EpochArray:
    step_ns = max(round(step_s * 1e9), 1)
    return np.append(np.arange(span.start_ns, span.stop_ns, step_ns, dtype=np.int64), np.int64(span.stop_ns))


def _tdb(span: _Span, t_ns: EpochArray) -> FloatArray:
    """SPICE times of samples, clipped to the kernel's ends: SPICE refuses times that lie a rounding beyond them."""
    return np.clip(tdb_seconds(t_ns), span.first_tdb, span.last_tdb)


@dataclass(frozen=True)
class FurtherCamera:
    """A camera beside the first: its ``frame`` and ``id`` in SPICE, its mounting and the covariance of its error."""

    frame: str
    id: int
    C_EC: FloatArray
    covariance_E: FloatArray | None = None


def frame_kernel_text(
    C_EK: FloatArray,
    from_name: str = "CAMERA",
    to_name: str = "STAR_TRACKER",
    *,
    ids: FrameIds = DEFAULT_IDS,
    covariance_E: FloatArray | None = None,
    comments: Sequence[str] = (),
    clock: int | None = None,
    further: Sequence[FurtherCamera] = (),
) -> str:
    """The mounting as a SPICE text frame kernel: ``pxform(from_name, to_name, et)`` is ``C_EK`` (3, 3).

    The camera is a fixed-offset (TK) frame relative to the tracker, the tracker a frame whose attitude comes
    from a C-kernel. With a ``clock`` the camera moves: its frame is of a C-kernel that goes by the clock of that
    id, and ``C_EK`` its mean, said as text. Names pass :func:`frame_name`. ``covariance_E`` (3, 3), rad^2 about the
    axes of E, and ``comments`` stand in the kernel as text; ``further`` cameras are frames like the first.
    Source: NAIF, Frames Required Reading. InputError where both names are one.
    """
    camera, tracker = frame_name(from_name), frame_name(to_name)
    if camera == tracker:
        raise InputError(f"the SPICE names of both frames are {camera}, wanted two different ones")
    data = _camera(camera, tracker, ids, C_EK) if clock is None else _moving(camera, ids, clock)
    if ids.tracker is not None:
        data += ["", *_definition(tracker, ids.tracker, 3, ids.spacecraft)]
    mean = None if clock is None else C_EK
    prose = [*_comment(_prose(camera, tracker, covariance_E, comments, mean))]
    for other in further:
        prose += ["", *_comment(_prose(other.frame, tracker, other.covariance_E, (), None))]
        data += ["", *_camera(other.frame, tracker, replace(ids, camera=other.id), other.C_EC)]
    return "\n".join(["KPL/FK", "", *prose, "", "\\begindata", "", *data, "", "\\begintext", ""])


def _camera(camera: str, tracker: str, ids: FrameIds, C_EK: FloatArray) -> list[str]:
    """A fixed-offset frame (class 4): its matrix, column by column, takes it to the tracker's."""
    columns = np.asarray(C_EK, dtype=float).mT.tolist()
    return [
        *_definition(camera, ids.camera, 4, ids.spacecraft),
        f"TKFRAME_{ids.camera}_RELATIVE = '{tracker}'",
        f"TKFRAME_{ids.camera}_SPEC = 'MATRIX'",
        f"TKFRAME_{ids.camera}_MATRIX = (",
        *("   " + " ".join(map(repr, column)) for column in columns),
        ")",
    ]


def _moving(camera: str, ids: FrameIds, clock: int) -> list[str]:
    """A frame (class 3) whose attitude comes from a C-kernel by a clock."""
    return [
        *_definition(camera, ids.camera, 3, ids.spacecraft),
        f"CK_{ids.camera}_SCLK = {clock}",
        f"CK_{ids.camera}_SPK = {ids.spacecraft}",
    ]


def _definition(name: str, frame_id: int, kind: int, center_id: int) -> list[str]:
    return [
        f"FRAME_{name} = {frame_id}",
        f"FRAME_{frame_id}_NAME = '{name}'",
        f"FRAME_{frame_id}_CLASS = {kind}",
        f"FRAME_{frame_id}_CLASS_ID = {frame_id}",
        f"FRAME_{frame_id}_CENTER = {center_id}",
    ]


def _prose(
    camera: str,
    tracker: str,
    covariance_E: FloatArray | None,
    comments: Sequence[str],
    mean: FloatArray | None,
) -> Iterator[str]:
    yield f"Mounting of {camera} on {tracker}, written by starplumb."
    if mean is None:
        yield f"The matrix takes coordinates from {camera} to {tracker}; SPICE lists it column by column."
    else:
        yield "It moves: load mounting.tsc and mounting.bc too. Its mean, row by row:"
        for row in mean:
            yield "   " + " ".join(f"{value: .15f}" for value in row)
    if covariance_E is not None:
        yield f"Covariance of its error about the axes of {tracker}, arcsec^2, row by row:"
        for row in np.asarray(covariance_E, dtype=float) / ARCSEC**2:
            yield "   " + " ".join(f"{value: .9e}" for value in row)
    yield from comments


def _comment(texts: Iterator[str]) -> Iterator[str]:
    """Comment lines that SPICE does not take for data: ASCII, within its limit of width, no backslash."""
    for text in texts:
        for line in text.splitlines() or [""]:
            plain = line.expandtabs(4).encode("ascii", "replace").decode().replace("\\", "/")
            yield from textwrap.wrap(plain, 80, initial_indent="   ", subsequent_indent="   ") or [""]
