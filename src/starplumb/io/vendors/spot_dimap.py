"""DIMAP version 1: scenes of SPOT 1 to 5 in the geometry of their sensor (level 1A, ``METADATA.DIM``).

Rows and columns count from 1; row l is exposed at ``SCENE_CENTER_TIME + LINE_PERIOD (l - SCENE_CENTER_LINE)``.  The
look direction of a detector in the satellite's axes N is ``(-tan PSI_Y, tan PSI_X, -1)``: x to the right of the
flight, y ahead, z up.  Attitude angles take N to the local orbital frame O by ``M_pitch M_roll M_yaw``, whose axes are
``Z = r / |r|, X = v x Z / |v x Z|, Y = Z x X`` with the velocity that the file states.
Source: S. Riazanoff, SPOT Satellite Geometry Handbook, S-NT-73-12-SI, 2002.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import tan

import numpy as np

from ...physics import so3
from ...physics.errors import InputError
from ...physics.light import Corrections
from ...physics.series import Ephemeris
from ..text.files import show
from ..text.tree import Array, Epochs, Node, require_increasing
from .dimap_attitude import AttitudeSamples
from .dimap_frame import corners_of, tie_points
from .spot_tracker import star_tracker
from .vendor import C_KV, AttitudeChoice, Detectors, Product

LOOK_ANGLES = "Data_Strip/Sensor_Configuration/Instrument_Look_Angles_List"
_ATTITUDES = "Data_Strip/Satellite_Attitudes"
_C_VN = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""The axes that the vendor's later products have (x along the flight, z down) from those of the handbook."""
_LEAST_POSITIONS = 4
_MOST_SCENE_S = 3600.0


@dataclass(frozen=True)
class _Orbit:
    t_ns: Epochs
    r_J: Array
    v_J: Array


@dataclass(frozen=True)
class _Angles:
    """Pitch, roll and yaw (n, 3) rad at ``t_ns`` (n,)."""

    t_ns: Epochs
    pitch_roll_yaw: Array


def read_spot(root: Node, attitude: AttitudeChoice, band: str | None) -> Product:
    """The scene of a version 1 document in our axes.

    ``attitude``: ``vendor``, the corrected angles in the local orbital frame, or ``raw``, the star tracker's
    quaternions of SPOT 5. Light effects are off with both: they are in the vendor's model and in these quaternions.
    Raises InputError for what is missing, contradicts itself or would have to be guessed.
    """
    if attitude == "filtered":
        raise root.error('attitude "filtered"', '"vendor" or "raw", which such a product has')
    _require_level(root)
    columns, rows = (root.need(f"Raster_Dimensions/{key}").whole(2) for key in ("NCOLS", "NROWS"))
    skipped = [_first(root, key) for key in ("COL_MIN", "ROW_MIN")]
    t_ns, period_s = _row_0(root, skipped[1])
    orbit = _orbit(root)
    detectors, said = _detectors(root, columns, skipped[0], band)
    vendor = _attitude(orbit, _angles(root))
    chosen = star_tracker(root, _ATTITUDES, vendor) if attitude == "raw" else vendor
    return Product(
        path=root.path,
        name=_name(root),
        columns=columns,
        rows=rows,
        detectors=detectors,
        t_ns=t_ns,
        line_period_s=period_s,
        orbit_t_ns=orbit.t_ns,
        r_J=orbit.r_J,
        v_J=None,
        attitude_t_ns=chosen.t_ns,
        q_EF=chosen.q_EF,
        frame=chosen.frame,
        C_EK=C_KV.mT,
        own_mounting=attitude == "vendor",
        corrections=Corrections(light_time=False, aberration=False, refraction=False),
        corners=tie_points(root, columns, rows) or corners_of(root.find("Dataset_Frame"), "FRAME_"),
        notices=(*said, *chosen.notices),
    )


def _require_level(root: Node) -> None:
    level = root.need("Data_Processing/PROCESSING_LEVEL")
    if level.text.upper() not in ("1A", "SENSOR"):
        raise level.error(show(level.text), '"1A", an image in the geometry of its sensor')


def _name(root: Node) -> str:
    for place in ("Dataset_Id/DATASET_NAME", "Dataset_Identification/DATASET_NAME"):
        if (node := root.find(place)) is not None and node.text:
            return node.text
    return root.path.stem


def _first(root: Node, key: str) -> int:
    """Columns or rows of the scene before the first one of an image cut out of it."""
    region = root.find(f"Data_Processing/Regions_Of_Interest/Region_Of_Interest/{key}")
    return region.whole(1) - 1 if region is not None else 0


def _row_0(root: Node, skipped: int) -> tuple[int, float]:
    """Epoch of our row 0, the vendor's row ``1 + skipped``, and the line period."""
    stamp = root.need("Data_Strip/Sensor_Configuration/Time_Stamp")
    period = stamp.need("LINE_PERIOD").positive()
    middle = stamp.need("SCENE_CENTER_LINE")
    after_s = period * (1 + skipped - middle.number())
    if abs(after_s) > _MOST_SCENE_S:
        raise middle.error(show(middle.text), f"a row at most {_MOST_SCENE_S:g} s from the first")
    return stamp.need("SCENE_CENTER_TIME").epoch() + round(1e9 * after_s), period


def _orbit(root: Node) -> _Orbit:
    parent = root.need("Data_Strip/Ephemeris/Points")
    points = parent.all("Point")
    if len(points) < _LEAST_POSITIONS:
        raise parent.error(f"{len(points)} positions", f"at least {_LEAST_POSITIONS}")
    t_ns = np.array([point.need("TIME").epoch() for point in points])
    require_increasing(points, t_ns)
    r_J, v_J = (
        np.array([[point.need(f"{what}/{axis}").number() for axis in "XYZ"] for point in points])
        for what in ("Location", "Velocity")
    )
    return _Orbit(t_ns, r_J, v_J)


def _angles(root: Node) -> _Angles:
    """The corrected angles; of the first satellites, which have none, the measured ones with their rates added up."""
    corrected = root.find(f"{_ATTITUDES}/Corrected_Attitudes/Corrected_Attitude")
    if corrected is not None:
        return _listed(corrected, "Angles")
    measured = root.need(f"{_ATTITUDES}/Raw_Attitudes/Aocs_Attitude")
    angles = _listed(measured.need("Angles_List"), "Angles")
    speeds = measured.find("Angular_Speeds_List")
    return angles if speeds is None else _added_up(angles, _listed(speeds, "Angular_Speeds"))


def _listed(parent: Node, key: str) -> _Angles:
    """The samples that are not OUT_OF_RANGE."""
    every = parent.all(key)
    kept = [node for node in every if (node.find("OUT_OF_RANGE") or node).text.upper() != "Y"]
    if not kept:
        raise parent.error(f"{len(every)} {key} and none of use", "at least one that is not OUT_OF_RANGE")
    t_ns = np.array([node.need("TIME").epoch() for node in kept])
    require_increasing(kept, t_ns)
    values = [[node.need(axis).number() for axis in ("PITCH", "ROLL", "YAW")] for node in kept]
    return _Angles(t_ns, np.array(values))


def _added_up(angles: _Angles, speeds: _Angles) -> _Angles:
    """Angles at the times of the rates: the integral of these (trapezia), through the first of the measured angles."""
    t = (speeds.t_ns - speeds.t_ns[0]) * 1e-9
    mean = 0.5 * (speeds.pitch_roll_yaw[1:] + speeds.pitch_roll_yaw[:-1])
    turned = np.vstack([np.zeros(3), np.cumsum(mean * np.diff(t)[:, None], axis=0)])
    at = (angles.t_ns[0] - speeds.t_ns[0]) * 1e-9
    start = np.array([np.interp(at, t, turned[:, axis]) for axis in range(3)])
    return _Angles(speeds.t_ns, angles.pitch_roll_yaw[0] + turned - start)


def _attitude(orbit: _Orbit, angles: _Angles) -> AttitudeSamples:
    """ITRF to V where the orbit is known: ``C_JV = [X Y Z] M_pitch M_roll M_yaw C_NV``."""
    known = (angles.t_ns >= orbit.t_ns[0]) & (angles.t_ns <= orbit.t_ns[-1])
    if np.count_nonzero(known) < 2:
        raise InputError("found attitudes outside the orbit's times, wanted them within")
    t_ns = angles.t_ns[known]
    r_J, v_J = (Ephemeris(orbit.t_ns, vectors).at(t_ns)[0] for vectors in (orbit.r_J, orbit.v_J))
    Z = r_J / np.linalg.norm(r_J, axis=-1, keepdims=True)
    X = np.cross(v_J, Z)
    X /= np.linalg.norm(X, axis=-1, keepdims=True)
    C_JO = np.stack([X, np.cross(Z, X), Z], axis=-1)
    pitch, roll, yaw = angles.pitch_roll_yaw[known].mT
    M = _turn(0, -pitch) @ _turn(1, -roll) @ _turn(2, yaw)
    return AttitudeSamples(t_ns, so3.to_quaternion((C_JO @ M @ _C_VN.mT).mT), "ITRF")


def _turn(axis: int, angle: Array) -> Array:
    """Right-handed rotations (n, 3, 3) by ``angle`` (n,) about an axis."""
    return so3.exp(angle[:, None] * np.eye(3)[axis])


def _detectors(root: Node, columns: int, skipped: int, band: str | None) -> tuple[Detectors, tuple[str, ...]]:
    """Tangents of every detector of the image's band, and what is to be said of them."""
    listed = _band(root, band).need("Look_Angles_List").all("Look_Angles")
    tan_x, tan_y = (np.array([tan(node.need(f"PSI_{axis}").number()) for node in listed]) for axis in "XY")
    last = float(columns - 1)
    column: Array = np.arange(len(listed), dtype=np.float64) - skipped
    said: tuple[str, ...] = ()
    if len(listed) < skipped + columns:
        if len(listed) < 2 or skipped:
            raise root.need(LOOK_ANGLES).error(
                f"{len(listed)} look angles for {skipped + columns} columns", "one a column"
            )
        column = np.linspace(0.0, last, len(listed))
        said = (f"{root.path}: the look angles of {len(listed)} detectors are spread over {columns} columns",)
    kept = np.flatnonzero((column >= 0.0) & (column <= last))
    return Detectors.from_vendor(column[kept], tan_x[kept], -tan_y[kept]), said


def _band(root: Node, band: str | None) -> Node:
    """The look angles of the only band, or of that with the BAND_INDEX or BAND_DESCRIPTION asked for."""
    parent = root.need(LOOK_ANGLES)
    bands = parent.all("Instrument_Look_Angles")
    if len(bands) == 1 and band is None:
        return bands[0]
    named = {(node.find("BAND_INDEX") or node.need("BAND_DESCRIPTION")).text: node for node in bands}
    words = {
        info.need("BAND_DESCRIPTION").text: info.need("BAND_INDEX").text
        for info in root.below("Spectral_Band_Info")
        if info.find("BAND_INDEX") is not None and info.find("BAND_DESCRIPTION") is not None
    }
    chosen = named.get(words.get(band or "", band or ""))
    if chosen is None:
        raise parent.error(f"the bands {', '.join(named)}", "one of them as band")
    return chosen
