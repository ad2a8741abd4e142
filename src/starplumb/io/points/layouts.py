"""The names that other programs give to the columns of a CSV file, or the attributes of GeoJSON, of ground points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...physics.errors import InputError
from ..text.files import show
from .ground_points import Row, finite, image_id


@dataclass(frozen=True)
class Layout:
    """One program's names; ``pixel`` is one attribute of two numbers, or two.

    ``image`` None: the file is of the image that has its name.  ``corner``: pixels count from the corner of the first
    pixel.  ``degrees``: x and y are longitude and latitude of WGS 84; else of a reference system that must be stated.
    """

    program: str
    name: str
    image: str | None
    pixel: tuple[str, ...]
    place: tuple[str, str]
    height: str
    corner: bool = False
    degrees: bool = False

    def needs(self, with_place: bool) -> tuple[str, ...]:
        """Attributes without which it is another layout."""
        image = () if self.image is None else (self.image,)
        return (*image, *self.pixel, *(self.place if with_place else ()))

    @property
    def shift_px(self) -> float:
        """What its pixel coordinates are ahead of ours."""
        return 0.5 if self.corner else 0.0

    def row(self, path: Path, where: str, number: int, values: Mapping[str, object]) -> Row:
        """The sighting of a feature or line, the ``number``-th of its file; its name may be missing."""
        image = path.stem if self.image is None else str(values.get(self.image) or "")
        if not image.strip():
            raise InputError(f"{where}: found no {self.image}, wanted the name of the image")
        pixel = values[self.pixel[0]] if len(self.pixel) == 1 else [values[key] for key in self.pixel]
        if not isinstance(pixel, list | tuple) or len(pixel) != 2:
            raise InputError(f"{where}: found no two numbers in {self.pixel[0]}, wanted column and row")
        column, row = (finite(where, value, f"a number in {', '.join(self.pixel)}") for value in pixel)
        x, y = (finite(where, values[key], f"a number in {key}") for key in self.place)
        stated = values.get(self.height)
        height = (
            np.nan if stated is None or stated == "" else finite(where, stated, f"a number in {self.height}")
        )
        own = values.get(self.name)
        name = str(own).strip() if own is not None and str(own).strip() else f"{image_id(image)}-{number}"
        return Row(where, name, image_id(image), x, y, height, column - self.shift_px, row - self.shift_px)


ORTHORITY = Layout("Orthority", "id", "filename", ("ji",), ("x", "y"), "z", degrees=True)
RASTERIO = Layout("rasterio", "id", None, ("col", "row"), ("x", "y"), "z", corner=True)
LAYOUTS = (
    ORTHORITY,
    Layout("OpenDroneMap", "gcp_name", "image_name", ("im_x", "im_y"), ("geo_x", "geo_y"), "geo_z"),
    RASTERIO,
    Layout(
        "starplumb",
        "landmark_id",
        "image_id",
        ("column_px", "row_px"),
        ("longitude_deg", "latitude_deg"),
        "height_m",
        degrees=True,
    ),
)
"""In the order in which they are tried."""


def layout_of(
    where: str, names: Sequence[str], among: Sequence[Layout] = LAYOUTS, with_place: bool = True
) -> Layout:
    """The layout whose attributes are all there.  Raises InputError where there is none."""
    for layout in among:
        if set(layout.needs(with_place)) <= set(names):
            return layout
    wanted = "; or ".join(f"{', '.join(layout.needs(with_place))} ({layout.program})" for layout in among)
    raise InputError(
        f"{where}: found {show(', '.join(map(str, names))) if names else 'no names'}, wanted {wanted}"
    )
