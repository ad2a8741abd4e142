"""Orbit and attitude from whatever file a campaign names, brought into the package's frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...physics import so3
from ...physics.earth import OMEGA_EARTH
from ...physics.errors import EpochError, InputError
from ...physics.orientation import C_IF, FRAMES_OF_DATE, EarthOrientation
from ...physics.rounding import decimal_step
from ...physics.series import Attitude, Ephemeris
from ...physics.timescales import format_iso
from ...physics.units import ARCSEC
from ..formats.registry import ATTITUDES, ORBITS, Asked, recognised
from ..formats.series_tables import AttitudeTable, EphemerisTable
from ..tables.cells import Array
from ..tables.columns import CARTESIAN
from ..tables.keys import TimedKeys
from ..tables.read import Epochs, Frame, Table, TableSource, read_table
from ..tables.rising import Rising, increasing
from ..text.files import show
from ..text.frames import EarthFrame, earth_frame
from ..text.numbers import SIGMA_WORDS, is_sigma
from ..text.values import UNIT_TOLERANCE
from .attitude_config import AttitudeConfig
from .config import EphemerisConfig
from .marks.landmarks import require_radius

VELOCITY = ("vx_m_s", "vy_m_s", "vz_m_s")
QUATERNION = ("qx", "qy", "qz", "qw")
SIGMA_ATTITUDE = ("sigma_x_arcsec", "sigma_y_arcsec", "sigma_z_arcsec")
ORBIT_RADIUS_M = (6.5e6, 5.0e7)
_MOST_SPEED_M_S = 1e6
"""Far above that of any orbit, so that noise of close samples passes."""
_AROUND_NS = 600 * 10**9
"""What of a kernel is sampled before the first image and after the last: a strip and the nodes around it."""
_CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class AttitudeSamples:
    """``q_EF`` (n, 4) at ``t_ns`` (n,) from the frame ``frame``, and their own sigmas (n, 3) rad where a
    table has them."""

    t_ns: Epochs
    q_EF: Array
    frame: EarthFrame
    sigma: Array | None
    name: str
    starts: tuple[int, ...] = ()
    quaternion_step: float = 0.0


def read_ephemeris(
    source: TableSource,
    config: EphemerisConfig,
    scale: str,
    images_t_ns: Epochs,
    orientation: EarthOrientation | None,
    notices: list[str],
) -> Ephemeris:
    """The orbit in J; of a SPICE kernel what surrounds the images (m,).

    Raises InputError where the file contradicts the campaign or holds no orbit around the Earth.
    """
    form = None if isinstance(source, Frame) else recognised(source, ORBITS)
    if form is None or isinstance(source, Frame):
        table = _ephemeris_table(source, config, scale)
    else:
        table = form.read(source, _asked(form.name, source, config, images_t_ns))
    notices += table.notices
    if table.frame != config.frame:
        word = show(table.frame_text or table.frame)
        raise InputError(f"{source}: found the frame {word}, wanted {config.frame} as ephemeris.frame says")
    _require_orbit(source, table)
    _require_speed(source, table)
    r_J, v_J = table.r, table.v
    if orientation is not None and table.frame != "ITRF":
        r_J, v_J = earth_fixed(source, table, orientation)
    try:
        starts = tuple(start for start, _ in table.segments[1:])
        return Ephemeris(table.t_ns, r_J, v_J, config.max_gap_s, str(source), starts)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None


def read_attitude(
    source: TableSource,
    config: AttitudeConfig,
    scale: str,
    notices: list[str],
    key: str = "attitude",
    kernels: tuple[Path, ...] = (),
) -> AttitudeSamples:
    """The attitude as C_EF of the section ``key``, E the star tracker's frame and F the Earth's or the inertial one."""
    form = None if isinstance(source, Frame) else recognised(source, ATTITUDES)
    if form is None or isinstance(source, Frame):
        _require_used(source, config, key, "table", "kernels", "object")
        return _attitude_table(source, config, scale, notices, key)
    unused = {"SPICE CK": ("object",), "ORBEX": ("kernels",), "CCSDS AEM": ("kernels",)}
    _require_used(source, config, key, form.name, *unused.get(form.name, ("kernels", "object")))
    _require_no_table_keys(form.name, source, config, key)
    table = form.read(source, Asked(config.object, frame=config.tracker, kernels=kernels))
    notices += table.notices
    return _standard_attitude(source, config, table, notices, key)


def _require_used(source: TableSource, config: AttitudeConfig, section: str, kind: str, *keys: str) -> None:
    """Raise InputError where a key is stated that a file of this kind has no use for."""
    purpose = {"kernels": "beside a SPICE C-kernel", "object": "where the file names its satellites"}
    for key in keys:
        if key in config.model_fields_set:
            raise InputError(f"{source}: found a {kind} beside {section}.{key}, wanted it {purpose[key]}")


def earth_fixed(
    source: TableSource, table: EphemerisTable, orientation: EarthOrientation
) -> tuple[Array, Array | None]:
    """Inertial states in J at their own epochs: ``r_J = C_JI r_I`` and ``v_J = C_JI v_I - omega x r_J``.

    States in a frame F of date are first turned by ``C_IF``, which itself turns by less than 1e-11 rad/s.
    """
    try:
        C_JI = orientation.C_IJ(table.t_ns).mT
        if table.frame in FRAMES_OF_DATE:
            C_JI = C_JI @ C_IF(table.frame, table.t_ns)
    except EpochError as error:
        raise InputError(f"{source}, sample {error.row + 1}: {error}") from None
    r_J = np.einsum("nij,nj->ni", C_JI, table.r)
    if table.v is None:
        return r_J, None
    return r_J, np.einsum("nij,nj->ni", C_JI, table.v) - np.cross([0.0, 0.0, OMEGA_EARTH], r_J)


def _ephemeris_table(source: TableSource, config: EphemerisConfig, scale: str) -> EphemerisTable:
    if config.object is not None:
        raise InputError(
            f"{source}: found a table beside ephemeris.object, wanted it where the file names its satellites"
        )
    declared, units = config.declared("ephemeris"), config.units

    def require_orbit(table: Table) -> None:
        for names, unit in ((CARTESIAN, units.metres), (VELOCITY, units.metres_a_second)):
            table.numbers.update(
                {name: unit * table.numbers[name] for name in names if name in table.numbers}
            )
        require_radius(table, table.columns(*CARTESIAN), ORBIT_RADIUS_M, "an orbit, from the Earth's centre")

    table = read_table(
        source,
        texts=("time",),
        numbers=CARTESIAN,
        optional_numbers=VELOCITY,
        declared=declared,
        each=Rising(scale, require_orbit),
    )
    require_orbit(table)
    return EphemerisTable(
        increasing(table, scale),
        r=table.columns(*CARTESIAN),
        v=table.columns(*VELOCITY) if table.has(*VELOCITY) else None,
        frame=config.frame,
        time_scale=scale,
        object_name="",
        segments=((0, len(table)),),
        notices=tuple(table.notices),
    )


def _asked(name: str, source: Path, config: EphemerisConfig, images_t_ns: Epochs) -> Asked:
    """What the campaign asks of a file in the standard format ``name``."""
    _require_no_table_keys(name, source, config, "ephemeris")
    start, stop = int(images_t_ns.min()) - _AROUND_NS, int(images_t_ns.max()) + _AROUND_NS
    return Asked(config.object, start, stop, config.frame)


def _require_no_table_keys(name: str, source: Path, config: TimedKeys, section: str) -> None:
    """Raise InputError where columns, units or times are declared of a file that says its own."""
    for key in ("columns", "keep", "time", "units"):
        if key in config.model_fields_set:
            raise InputError(
                f"{source}: found a file of the format {name}, which is no table (CSV, Parquet or Arrow), "
                f"wanted {section}.{key} left out"
            )


def _require_orbit(source: TableSource, table: EphemerisTable) -> None:
    """Positions about another centre, or in wrong units, are seen by their radius."""
    radius = np.linalg.norm(table.r, axis=-1)
    low, high = ORBIT_RADIUS_M
    good = (radius >= low) & (radius <= high)
    if not good.all():
        row = int(np.argmin(good))
        time = format_iso(table.t_ns[row], table.time_scale, 3)[0]
        where = f"{source}, the position at {time} {table.time_scale}"
        found = f"found it {radius[row]:.7g} m from the Earth's centre"
        raise InputError(f"{where}: {found}, wanted {low / 1e3:g} to {high / 1e3:g} km")


def _require_speed(source: TableSource, table: EphemerisTable) -> None:
    """Positions that leap, or velocities of no satellite, would count as faster than light."""
    speed = np.linalg.norm(np.diff(table.r, axis=0), axis=-1) / (1e-9 * np.diff(table.t_ns))
    if table.v is not None:
        speed = np.maximum(np.append(speed, 0.0), np.linalg.norm(table.v, axis=-1))
    if not (speed < _MOST_SPEED_M_S).all():
        row = int(np.argmax(speed))
        time = format_iso(table.t_ns[row], table.time_scale, 3)[0]
        raise InputError(
            f"{source}, the position at {time} {table.time_scale}: found a speed of {speed[row]:.3g} m/s, "
            f"wanted one below {_MOST_SPEED_M_S:g} m/s"
        )


def _attitude_table(
    source: TableSource, config: AttitudeConfig, scale: str, notices: list[str], key: str
) -> AttitudeSamples:
    table = read_table(
        source,
        texts=("time",),
        numbers=QUATERNION,
        optional_numbers=SIGMA_ATTITUDE,
        declared=config.declared(key),
        each=Rising(scale, _require_attitude),
    )
    notices += table.notices
    t_ns = increasing(table, scale)
    _require_attitude(table)
    q = table.columns(*QUATERNION)
    sigma = ARCSEC * table.columns(*SIGMA_ATTITUDE) if table.has(*SIGMA_ATTITUDE) else None
    step = decimal_step(q)
    q, frame = _to_tracker(q / np.linalg.norm(q, axis=-1)[:, None], config.source, config.target)
    return AttitudeSamples(t_ns, q, frame, sigma, str(source), quaternion_step=step)


def _require_attitude(table: Table) -> None:
    """Raise InputError for a quaternion that is no rotation, and a sigma that is none."""
    norm = np.linalg.norm(table.columns(*QUATERNION), axis=-1)
    off = np.abs(norm - 1.0) > UNIT_TOLERANCE
    if off.any():
        row = int(np.argmax(off))
        where = table.where(row, *QUATERNION)
        raise InputError(f"{where}: found a quaternion of norm {norm[row]:.6g}, wanted norm 1")
    if table.has(*SIGMA_ATTITUDE):
        for name in SIGMA_ATTITUDE:
            wanted = f"a positive number of arcseconds, {SIGMA_WORDS}"
            table.require(is_sigma(table.numbers[name], exact=False), name, wanted)


def _standard_attitude(
    path: Path, config: AttitudeConfig, table: AttitudeTable, notices: list[str], section: str
) -> AttitudeSamples:
    """A file that names its frames must lead from and to where the campaign says; a tracker may have another
    name."""
    for key, stated, word in (("from", config.source, table.frame_a), ("to", config.target, table.frame_b)):
        if earth_frame(word) != earth_frame(stated):
            raise InputError(
                f"{path}: found the frame {show(word)}, wanted {show(stated)} as {section}.{key} says"
            )
        if earth_frame(word) is None and word not in (stated, ""):
            notices.append(f"{path}: took its frame {word} for {stated}, the name in the campaign")
    q, frame = _to_tracker(table.q_BA_xyzw, config.source, config.target)
    starts = tuple(start for start, _ in table.segments[1:])
    return AttitudeSamples(table.t_ns, q, frame, None, str(path), starts)


def _to_tracker(q: Array, source: str, target: str) -> tuple[Array, EarthFrame]:
    """q_EF and F of quaternions that take ``source`` to ``target``, one of which is F."""
    if (frame := earth_frame(source)) is not None:
        return q, frame
    if (frame := earth_frame(target)) is not None:
        return q * _CONJUGATE, frame
    raise ValueError(f"neither {source} nor {target} is a frame of the Earth")


def attitude_series(
    samples: AttitudeSamples,
    config: AttitudeConfig,
    orientation: EarthOrientation | None,
    C_EA: Array | None = None,
) -> Attitude:
    """The series that interpolates the samples, turned by ``C_EA`` (3, 3) where E is not their own frame A.

    Samples that refer to a frame F of date are turned into the GCRF: ``C_EI = C_EF C_IF^T``.
    """
    q_EF, frame = samples.q_EF, samples.frame
    if frame == "TEME" or frame == "TOD" or frame == "MOD":  # mypy follows this
        C_EI = so3.from_quaternion(q_EF) @ C_IF(frame, samples.t_ns).mT
        q_EF, frame = so3.to_quaternion(C_EI), "GCRF"
    if C_EA is not None:
        q_EF = so3.to_quaternion(C_EA @ so3.from_quaternion(q_EF))
    inertial = orientation if frame == "GCRF" else None
    return Attitude(
        samples.t_ns,
        q_EF,
        frame,
        inertial,
        config.max_gap_s,
        samples.name,
        samples.starts,
        samples.quaternion_step,
    )
