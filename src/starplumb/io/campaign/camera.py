"""The camera of a campaign: its optics, or a line scanner's table of look directions."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...physics.camera import Camera, Distortion, FrameCamera, LineScanCamera
from ...physics.errors import InputError
from ...physics.units import MM, UM
from ..tables.read import TableSource, read_table
from .cameras.config import CameraConfig


def pixel_shift(config: CameraConfig) -> float:
    """Half a pixel where (0, 0) is the corner of the first pixel, since it is the centre for us."""
    return 0.5 if config.pixel_origin == "corner" else 0.0


def read_camera(config: CameraConfig, look_angles: TableSource | None, notices: list[str]) -> Camera:
    """The camera of the [camera] section; ``look_angles`` is its table of look directions, if it names
    one."""
    shift = pixel_shift(config)
    if look_angles is not None:
        return _tabulated_camera(config, look_angles, notices)
    optics = (config.focal_length_mm, config.pixel_pitch_um, config.image_size_px, config.principal_point_px)
    focal_length, pitch, size, point = optics
    if focal_length is None or pitch is None or size is None or point is None:
        raise ValueError("the camera lacks its optics")
    center = (point[0] - shift, point[1] - shift)
    factor = config.binning[0]
    distortion = Distortion(config.distortion.k, config.distortion.p) if config.distortion else Distortion()
    if config.model == "frame":
        read = (_read_out(config, center[i], i) for i in range(2))
        columns, rows = _size(config, size)
        return FrameCamera(MM * focal_length, UM * pitch * factor, tuple(read), (columns, rows), distortion)
    # the row of a line scanner's principal point is an offset from the line, which has no origin to shift
    principal = (_read_out(config, center[0], 0), point[1] / factor)
    columns = int(_size(config, size)[0])
    return LineScanCamera.from_optics(MM * focal_length, UM * pitch * factor, principal, columns, distortion)


def _read_out(config: CameraConfig, full_px: Any, axis: int) -> Any:
    """Where places of the full sensor, columns or rows, are in the image: ``(u + 1/2) / binning - 1/2 - first``."""
    first = 0 if config.window_px is None else config.window_px[axis]
    return (full_px + 0.5) / config.binning[axis] - 0.5 - first


def _size(config: CameraConfig, full_px: tuple[int, int]) -> tuple[float, float]:
    """Columns and rows of the image."""
    if config.window_px is not None:
        return float(config.window_px[2]), float(config.window_px[3])
    return float(full_px[0] // config.binning[0]), float(full_px[1] // config.binning[1])


def _tabulated_camera(config: CameraConfig, source: TableSource, notices: list[str]) -> LineScanCamera:
    table = read_table(source, numbers=("column_px", "tan_x", "tan_y"))
    notices += table.notices
    if len(table) < 2:
        raise InputError(f"{source}: found one detector, wanted the look directions of at least two")
    column, tan = table.numbers["column_px"], table.columns("tan_x", "tan_y")
    rises = np.concatenate([[True], np.diff(column) > 0.0])
    table.require(rises, "column_px", "columns that increase")
    along, _ = LineScanCamera(column, tan[:, 0], tan[:, 1], (0.0, 0.0)).axes
    one_way = np.concatenate([[True], np.diff(tan, axis=0) @ along > 0.0])
    table.require(one_way, "tan_x", "look directions that go on and on from the first detector to the last")
    last = int(np.floor(column[-1] - pixel_shift(config))) + 1
    columns = int(_size(config, config.image_size_px or (last, 1))[0])
    column = _read_out(config, column - pixel_shift(config), 0)
    if column[0] > 0.5 or column[-1] < columns - 1.5:
        found = f"found look directions for the columns {column[0]:g} to {column[-1]:g}"
        raise InputError(f"{source}, column column_px: {found}, wanted them for 0 to {columns - 1}")
    return LineScanCamera(column, tan[:, 0], tan[:, 1], (float(columns), np.inf))
