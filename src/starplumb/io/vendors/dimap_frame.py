"""The ground points that a DIMAP file states for pixels: its corners and centre, or tie points."""

from __future__ import annotations

import numpy as np

from ...physics.units import DEG
from ..text.tree import Node
from .vendor import Corners


def corners_of(frame: Node | None, prefix: str = "") -> Corners | None:
    """Vertices and centre with their pixels, whose keys begin with ``prefix``; None where a pixel is not stated.

    Not every layout says their heights.
    """
    nodes = [*frame.all("Vertex"), *frame.all("Center")] if frame else []
    keys = [f"{prefix}{key}" for key in ("LON", "LAT", "COL", "ROW")]
    if not nodes or any(node.find(key) is None for node in nodes for key in keys[2:]):
        return None
    lon, lat, column, row = (np.array([node.need(key).number() for node in nodes]) for key in keys)
    heights = [node.find("H") for node in nodes]
    height = np.array([np.nan if node is None else node.number() for node in heights])
    names = tuple(node.place.rpartition("/")[2].lower() for node in nodes)
    return Corners(names, DEG * lat, DEG * lon, height, column - 1.0, row - 1.0)


def tie_points(root: Node, columns: int, rows: int) -> Corners | None:
    """The vendor's own locations of pixels in the image at stated heights, as version 1 has them; None without any."""
    nodes = root.below("Tie_Point")
    keys = ("CRS_X", "CRS_Y", "CRS_Z", "DATA_X", "DATA_Y")
    if any(node.find(f"TIE_POINT_{key}") is None for node in nodes for key in keys):
        return None
    points = np.array([[node.need(f"TIE_POINT_{key}").number() for key in keys] for node in nodes]).reshape(
        -1, 5
    )
    points = points[(points[:, 3] <= columns) & (points[:, 4] <= rows)]
    if not len(points):
        return None
    lon, lat, height, column, row = points.mT
    names = tuple(f"tie_point_{i}" for i in range(1, len(points) + 1))
    return Corners(names, DEG * lat, DEG * lon, height, column - 1.0, row - 1.0)
