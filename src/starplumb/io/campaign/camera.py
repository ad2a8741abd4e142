"""The camera of a campaign: its optics, or a line scanner's table of look directions."""

from __future__ import annotations

import numpy as np

from ...physics.camera import Camera, Distortion, FrameCamera, LineScanCamera
from ...physics.errors import InputError
from ...physics.units import MM, UM
from ..tables.read import TableSource, read_table
from .config import CameraConfig


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
    distortion = Distortion(config.distortion.k, config.distortion.p) if config.distortion else Distortion()
    if config.model == "frame":
        return FrameCamera(
            MM * focal_length, UM * pitch, center, (float(size[0]), float(size[1])), distortion
        )
    # the row of a line scanner's principal point is an offset from the line, which has no origin to shift
    return LineScanCamera.from_optics(
        MM * focal_length, UM * pitch, (center[0], point[1]), size[0], distortion
    )


def _tabulated_camera(config: CameraConfig, source: TableSource, notices: list[str]) -> LineScanCamera:
    table = read_table(source, numbers=("column_px", "tan_x", "tan_y"))
    notices += table.notices
    if len(table) < 2:
        raise InputError(f"{source}: found one detector, wanted the look directions of at least two")
    column, tan_x = table.numbers["column_px"], table.numbers["tan_x"]
    rises = np.concatenate([[True], np.diff(column) > 0.0])
    table.require(rises, "column_px", "columns that increase")
    one_way = np.concatenate([[True], np.diff(tan_x) * (tan_x[-1] - tan_x[0]) > 0.0])
    table.require(one_way, "tan_x", "tangents that only rise or only fall along the line")
    column = column - pixel_shift(config)
    columns = config.image_size_px[0] if config.image_size_px else int(np.floor(column[-1])) + 1
    if column[0] > 0.5 or column[-1] < columns - 1.5:
        found = f"found look directions for the columns {column[0]:g} to {column[-1]:g}"
        raise InputError(f"{source}, column column_px: {found}, wanted them for 0 to {columns - 1}")
    return LineScanCamera(column, tan_x, table.numbers["tan_y"], (float(columns), np.inf))
