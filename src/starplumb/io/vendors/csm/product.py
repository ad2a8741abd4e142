"""A community sensor model as a product in our axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ....physics import so3
from ....physics.camera import Distortion, FrameCamera
from ....physics.errors import InputError
from ....physics.light import Corrections
from ....physics.orientation import EarthOrientation
from ....table.row_times import RowTimes
from ...campaign.motion import earth_fixed
from ...formats.series_tables import EphemerisTable, EpochArray
from ...formats.spice import t_ns_of_tdb
from ...text.files import read_text, show
from ...text.json_node import JsonNode
from ..vendor import Detectors, Product
from .isd import read_isd
from .model import Array, CsmModel
from .optics import RADTAN
from .state import FRAME, LINE_SCANNER, read_state

_NODES = 1025
"""Columns at which a distorted line is tabulated."""
_SQUARE = 1e-6


def read_csm(path: Path) -> Product:
    """The image that a model state or an ISD describes.

    E is the camera's own axes, in which the attitude is given, and the mounting the turn from K to them. Raises
    InputError for other sensor models, planets and lenses.
    """
    model = _read(path)
    t_ns = _Clock(model)
    r_J, v_J = _orbit(model, t_ns(model.orbit_s))
    C_JC = so3.from_quaternion(model.q_FC)
    toward = -r_J[len(r_J) // 2] if model.frame == "ITRF" else -model.r_F[len(model.r_F) // 2]
    ahead = 1.0 if C_JC[len(C_JC) // 2][:, 2] @ toward > 0.0 else -1.0
    C_KC, camera, detectors = _scanner(model, ahead) if model.lines is not None else _matrix(model, ahead)
    first, period_s, rows = _rows(model, t_ns)
    undated = (
        "states no day: its times count from 2000-01-01T12:00:00 TAI, on which nothing in the answer depends"
    )
    return Product(
        path=path,
        name=model.name,
        columns=model.size[0],
        rows=model.size[1],
        detectors=detectors,
        t_ns=first,
        line_period_s=period_s,
        orbit_t_ns=t_ns(model.orbit_s),
        r_J=r_J,
        v_J=v_J,
        attitude_t_ns=t_ns(model.attitude_s),
        q_EF=model.q_FC * np.array([-1.0, -1.0, -1.0, 1.0]),
        frame=model.frame,
        C_EK=C_KC.mT,
        corrections=Corrections(light_time=False, aberration=False, refraction=False),
        notices=() if model.dated else (f"{path}: {undated}",),
        frame_camera=camera,
        row_times=rows,
    )


def _read(path: Path) -> CsmModel:
    """A state has the name of its sensor model in a line before the JSON, or in it; an ISD has other keys."""
    text = read_text(path)
    named = text.split("\n", 1)[0].strip() if not text.lstrip().startswith("{") else ""
    node = JsonNode.of(path, text.split("\n", 1)[1] if named and "\n" in text else text)
    if node.has("name_model"):
        return _with_optics(read_isd(node))
    name = named or node.text("m_modelName")
    if name not in (LINE_SCANNER, FRAME):
        raise InputError(f"{path}: found the sensor model {show(name)}, wanted {LINE_SCANNER} or {FRAME}")
    return _with_optics(read_state(node, name))


def _with_optics(model: CsmModel) -> CsmModel:
    """The model; raises InputError where its pixels stand for no places in the focal plane."""
    optics = model.optics
    toward = np.array([optics.lines[1:], optics.samples[1:]])
    sound = 0.0 < abs(optics.focal_length) < np.inf and bool(np.all(np.abs(toward) < _STEEPEST))
    if not sound or np.linalg.cond(toward) > _FLATTEST:
        found = f"a focal length of {optics.focal_length:g} mm and the transformations {show(toward.ravel().tolist())}"
        raise InputError(
            f"{model.path}: found {found}, wanted those from the focal plane to two axes of pixels"
        )
    return model


_FLATTEST, _STEEPEST = 1e6, 1e9
"""Condition of the transformation from the focal plane to pixels, some 1 where pixels are square, and pixels per mm."""
_MOST_S = 6e9
"""Of seconds since 2000, which nanoseconds can count."""


class _Clock:
    """Epochs (n,) of a model's seconds (n,)."""

    def __init__(self, model: CsmModel) -> None:
        self._dated, self._path = model.dated, model.path

    def __call__(self, seconds: Array) -> EpochArray:
        if not (np.abs(seconds) < _MOST_S).all():
            raise InputError(
                f"{self._path}: found times centuries away, wanted seconds of an image of the Earth"
            )
        if self._dated:
            return t_ns_of_tdb(np.asarray(seconds))
        return np.rint(1e9 * np.asarray(seconds)).astype(np.int64)


def _orbit(model: CsmModel, t_ns: EpochArray) -> tuple[Array, Array | None]:
    if model.frame == "ITRF":
        return model.r_F, model.v_F
    table = EphemerisTable(t_ns, model.r_F, model.v_F, "GCRF", "TAI", "", ((0, len(t_ns)),))
    return earth_fixed(model.path, table, EarthOrientation.load())


def _rows(model: CsmModel, t_ns: _Clock) -> tuple[int, float, RowTimes | None]:
    """Epoch of row 0, line period, and the table of rows where there are several periods; a frame has none."""
    if model.lines is None:
        return int(t_ns(np.array([model.time_s]))[0]), 0.0, None
    line, time_s, step_s = model.lines.mT
    first = time_s[0] + step_s[0] * (0.5 - line[0])
    if len(line) == 1:
        return int(t_ns(np.array([first]))[0]), float(step_s[0]), None
    last = model.size[1] - 1.0
    row = np.concatenate([[0.0], line[1:] - 0.5, [last]])
    exposed = np.concatenate([[first], time_s[1:], [time_s[-1] + step_s[-1] * (last + 0.5 - line[-1])]])
    inside = (row >= 0.0) & (row <= last)
    row, late = np.unique(row[inside], return_index=True)
    epochs = t_ns(exposed[inside][late])
    steps = np.diff(epochs)
    if not (np.all(steps > 0) or np.all(steps < 0)):
        raise InputError(f"{model.path}: found times of lines that turn back, wanted them to go one way")
    rows = RowTimes(row, epochs - epochs[0], "the times of its lines")
    return int(epochs[0]), rows.mean_period_s, rows


def _scanner(model: CsmModel, ahead: float) -> tuple[Array, None, Detectors]:
    """C_KC and the look directions of the detectors; x of K is the axis of the camera along which columns grow most."""
    n = model.size[0]
    plain = not np.any(model.optics.coefficients)
    column = np.linspace(0.0, n - 1.0, 2 if plain else min(n, _NODES))
    tan_C = model.optics.tangents(np.zeros(column.size), column + 0.5)
    along = ahead * (tan_C[-1] - tan_C[0])
    x_K = np.zeros(3)
    at = int(np.argmax(np.abs(along)))
    x_K[at] = np.sign(along[at])
    z_K = np.array([0.0, 0.0, ahead])
    C_KC = np.stack([x_K, np.cross(z_K, x_K), z_K])
    tan = ahead * tan_C @ C_KC[:2, :2].mT
    return C_KC, None, Detectors(column, tan[:, 0], tan[:, 1])


def _matrix(model: CsmModel, ahead: float) -> tuple[Array, FrameCamera, Detectors]:
    """C_KC and the camera of a frame, whose pixels must be square."""
    optics = model.optics
    scale = np.linalg.inv(np.array([optics.samples[1:], optics.lines[1:]])) / optics.focal_length
    column, row = scale[:, 0], scale[:, 1]
    size = np.linalg.norm(column)
    square = abs(column @ row) < _SQUARE * size**2 and abs(np.linalg.norm(row) / size - 1.0) < _SQUARE
    if not square:
        raise InputError(
            f"{model.path}: found pixels that are not square, wanted square ones of a frame camera"
        )
    if np.sign(column[0] * row[1] - column[1] * row[0]) != ahead:
        raise InputError(
            f"{model.path}: found an image that is mirrored, wanted columns and rows as the camera sees them"
        )
    turn = np.stack([column, row]) / size
    C_KC = np.zeros((3, 3))
    C_KC[:2, :2], C_KC[2, 2] = ahead * turn, ahead
    center = np.array([optics.origin[1] + optics.samples[0], optics.origin[0] + optics.lines[0]]) - 0.5
    columns, rows = model.size
    camera = FrameCamera(
        focal_length=1e-3 * optics.focal_length,
        pitch=float(1e-3 * optics.focal_length * size),
        principal_point_px=(float(center[0]), float(center[1])),
        size_px=(float(columns), float(rows)),
        distortion=_distortion(model, turn),
    )
    nothing = np.empty(0)
    return C_KC, camera, Detectors(nothing, nothing, nothing)


def _distortion(model: CsmModel, turn: Array) -> Distortion:
    """The lens in K's axes; the tangential part turns with them."""
    c = model.optics.coefficients
    if not np.any(c):
        return Distortion()
    if model.optics.kind != RADTAN:
        found = f"found a {model.optics.kind} distortion of a frame"
        raise InputError(f"{model.path}: {found}, wanted none or radial-tangential (radtan)")
    k1, k2, p1, p2, k3 = (float(value) for value in c)
    p2, p1 = (float(value) for value in turn @ np.array([p2, p1]))
    return Distortion((k1, k2, k3), (p1, p2))
