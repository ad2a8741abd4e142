"""The ground points that a DIMAP file states for pixels: its corners and centre."""

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
