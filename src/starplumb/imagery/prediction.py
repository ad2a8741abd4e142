"""Pieces of the reference as the camera should see them: sampled on a grid of pixels that is laid on the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.earth import geodetic_to_itrf
from .scene import Scene, geodetic

Array = NDArray[np.float64]

NODES = 5
"""Lines of sight along each side of a piece that are followed to the terrain; between them the ground is smooth."""


@dataclass(frozen=True)
class Sights:
    """Where lines of sight around a pixel meet the ground: latitude and longitude (k, k) rad of rows and columns
    ``at_px`` (k,) from it; between them the ground is smooth."""

    at_px: Array
    latitude: Array
    longitude: Array

    def place(self, rows: Array, columns: Array) -> tuple[Array, Array]:
        """Latitude and longitude (r, c) rad of rows (r,) and columns (c,) from the pixel."""
        from scipy.interpolate import RectBivariateSpline

        latitude, longitude = (
            np.asarray(RectBivariateSpline(self.at_px, self.at_px, values)(rows, columns))
            for values in (self.latitude, self.longitude)
        )
        return latitude, longitude


@dataclass(frozen=True)
class Piece:
    """A piece of the reference around a pixel: ``samples`` (k, k), NaN where unknown, every ``step_px`` pixels; its
    middle is the ground point ``p_J`` (3,).  ``sights`` say where its other samples lie, None where nobody asks."""

    samples: Array
    step_px: float
    p_J: Array
    sights: Sights | None = None

    def ground(self, scene: Scene, point_px: Array) -> Array:
        """The ground point (3,) of what it shows at ``point_px`` (2,), columns and rows from its middle."""
        if self.sights is None:
            return self.p_J
        latitude, longitude = self.sights.place(point_px[1:], point_px[:1])
        latitude, longitude = latitude.ravel(), longitude.ravel()
        return np.asarray(geodetic_to_itrf(latitude, longitude, scene.height_at(latitude, longitude))[0])

    @property
    def known(self) -> float:
        """The part of the samples that is known."""
        return float(np.mean(np.isfinite(self.samples)))


def pieces(
    scene: Scene, C_EK: Array, image: int, centre_px: Array, reach_px: float, step_px: float
) -> list[Piece | None]:
    """The reference around pixels (n, 2) of an image, as far as ``reach_px`` to each side; None where the ground is not
    known.  Raises EpochError for pixels outside the orbit or attitude."""
    count = int(np.ceil(reach_px / step_px))
    half = count * step_px
    nodes = np.linspace(-half, half, NODES)
    offset = np.stack(np.meshgrid(nodes, nodes), axis=-1).reshape(-1, 2)
    pixel = (centre_px[:, None, :] + offset).reshape(-1, 2)
    p_J = scene.ground(C_EK, image, pixel).reshape(len(centre_px), NODES, NODES, 3)
    spacing_m = step_px * scene.pixel_m(C_EK, image, centre_px.mean(axis=0)) if len(centre_px) else 1.0
    at = np.arange(-count, count + 1, dtype=np.float64) * step_px
    return [_piece(scene, each, nodes, at, spacing_m, step_px) for each in p_J]


def _piece(
    scene: Scene, p_J: Array, nodes: Array, at: Array, spacing_m: float, step_px: float
) -> Piece | None:
    if not np.all(np.isfinite(p_J)):
        return None
    latitude, longitude = geodetic(p_J)
    sights = Sights(nodes, latitude, np.unwrap(np.unwrap(longitude, axis=0), axis=1))
    samples = scene.reference.sample(*sights.place(at, at), spacing_m)
    return Piece(samples, step_px, p_J[NODES // 2, NODES // 2], sights)
