"""A vendor's image product in our axes and units: what the readers of all vendors return."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...physics.camera import FrameCamera, LineScanCamera
from ...physics.earth import geodetic_to_itrf
from ...physics.errors import InputError
from ...physics.light import Corrections
from ...physics.orientation import EarthOrientation
from ...physics.series import Attitude, Bursts, Ephemeris
from ...physics.units import ARCSEC
from ...table.campaign import Campaign, Images, Landmarks, Sightings
from ...table.geometry import locate
from ...table.row_times import RowTimes
from ..text.files import show

Array = NDArray[np.float64]
Epochs = NDArray[np.int64]
AttitudeChoice = Literal["vendor", "filtered", "raw"]
Sigma = float | Sequence[float]
"""One number, or three along or about the axes."""

CORNERS_AGREE_M = 20.0
"""Corners farther than this from the geometry that located them, but for the turn of a mounting, are not to be used."""
C_KV = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""K from the vendors' camera axes V (x along track, y to its right, z to the scene): columns grow towards -y_V, rows
towards x_V."""


@dataclass(frozen=True)
class Detectors:
    """Look directions ``(tan_x, tan_y, 1)`` in K of the columns ``column_px``, (d,) each, linear between them."""

    column_px: Array
    tan_x: Array
    tan_y: Array

    @classmethod
    def from_vendor(cls, column_px: Array, x_V: Array, y_V: Array) -> Detectors:
        """From the tangents x/z and y/z in the vendors' camera axes."""
        tan = np.stack(np.broadcast_arrays(x_V, y_V), axis=-1) @ C_KV[:2, :2].mT
        return cls(column_px, tan[:, 0], tan[:, 1])


@dataclass(frozen=True)
class Corners:
    """Ground points that the product states for pixels: rad, m above the ellipsoid, pixels, (c,) each.

    ``height`` is NaN where the product does not say it.
    """

    names: tuple[str, ...]
    latitude: Array
    longitude: Array
    height: Array
    column_px: Array
    row_px: Array

    @property
    def have_heights(self) -> bool:
        return bool(np.all(np.isfinite(self.height)))

    @property
    def r_J(self) -> Array:
        """Positions (c, 3), m; on the ellipsoid where the height is not known."""
        return geodetic_to_itrf(self.latitude, self.longitude, np.nan_to_num(self.height))


@dataclass(frozen=True)
class Product:
    """One image of one line scanner, or of the ``frame_camera``, which has no detectors and no line period.

    ``q_EF`` (n, 4) takes ``frame`` to E, the axes in which the attitude is given; ``C_EK`` is the mounting as the
    product states it (then ``own_mounting``), or the turn of the axes alone. Row r is exposed at
    ``t_ns + r line_period_s``; a scan against the count of the rows has a negative period; ``row_times`` has the times
    of uneven rows. Sigmas are those the product states, rad and m.
    """

    path: Path
    name: str
    columns: int
    rows: int
    detectors: Detectors
    t_ns: int
    line_period_s: float
    orbit_t_ns: Epochs
    r_J: Array
    v_J: Array | None
    attitude_t_ns: Epochs
    q_EF: Array
    frame: Literal["GCRF", "ITRF"]
    C_EK: Array
    corrections: Corrections
    sigma_position: Array | None = None
    sigma_attitude: Array | None = None
    corners: Corners | None = None
    row_times: RowTimes | None = None
    own_mounting: bool = False
    notices: tuple[str, ...] = ()
    frame_camera: FrameCamera | None = None

    def campaign(self, sigma_m: Sigma | None = None, sigma_arcsec: Sigma | None = None) -> Campaign:
        """The product without landmarks. Sigmas given here, one or three, replace the product's own.

        Raises InputError for a sigma that is not positive, or that is stated nowhere.
        """
        position = self.sigma_position if sigma_m is None else _three("sigma_m", sigma_m)
        attitude = (
            self.sigma_attitude if sigma_arcsec is None else ARCSEC * _three("sigma_arcsec", sigma_arcsec)
        )
        if position is None or attitude is None:
            lacking = {"sigma_m": position, "sigma_arcsec": attitude}
            wanted = " and ".join(name for name, sigma in lacking.items() if sigma is None)
            raise InputError(
                f"{self.path}: found no sigma of its positions or attitude, wanted {wanted} stated"
            )
        inertial = EarthOrientation.load() if self.frame == "GCRF" else None
        index, value = np.empty(0, dtype=np.int64), np.empty(0)
        return Campaign(
            name=self.name,
            camera=self._camera,
            C_EK=self.C_EK,
            sigma_mounting=None,
            ephemeris=Ephemeris(self.orbit_t_ns, self.r_J, self.v_J),
            sigma_position=position,
            position_frame="ITRF",
            attitude=Attitude(self.attitude_t_ns, self.q_EF, self.frame, inertial),
            cov_attitude_E=np.diag(attitude**2),
            landmarks=Landmarks((), np.empty((0, 3)), np.empty((0, 3, 3))),
            images=self._images,
            sightings=Sightings(index, index, value, value, value, np.empty(0, dtype=np.bool_)),
            corrections=self.corrections,
            orientation=inertial,
        )

    @property
    def _camera(self) -> FrameCamera | LineScanCamera:
        table, size = self.detectors, (float(self.columns), float(self.rows))
        return self.frame_camera or LineScanCamera(table.column_px, table.tan_x, table.tan_y, size)

    @property
    def _images(self) -> Images:
        t_ns = np.array([self.t_ns])
        if self.frame_camera is not None:
            return Images((self.name,), t_ns)
        rows = None if self.row_times is None else (self.row_times,)
        return Images((self.name,), t_ns, np.array([self.line_period_s]), row_times=rows)


def corners_missed(product: Product, campaign: Campaign) -> float:
    """How far the product's model is from the worst of the corners whose rows its samples cover, m.

    ``campaign`` is the product's own. Raises EpochError where they cover none of them.
    """
    if product.corners is None:
        raise ValueError("the product has no corners")
    c = product.corners
    image, height = np.zeros(len(c.names), dtype=np.int64), np.nan_to_num(c.height)
    t_ns = campaign.images.exposed(image, c.row_px)
    orbit, attitude = Bursts(product.orbit_t_ns), Bursts(product.attitude_t_ns)
    covered = orbit.covers(t_ns) & attitude.covers(t_ns)
    chosen = covered if covered.any() else np.ones_like(covered)
    met = locate(campaign, product.C_EK, image[chosen], c.column_px[chosen], c.row_px[chosen], height[chosen])
    return float(np.max(np.linalg.norm(met - c.r_J[chosen], axis=-1)))


def _three(name: str, sigma: Sigma) -> Array:
    """A sigma for each axis."""
    values = np.atleast_1d(np.asarray(sigma, dtype=np.float64))
    if values.shape not in ((1,), (3,)) or not np.all(np.isfinite(values) & (values >= 0.0)):
        raise InputError(f"{name}: found {show(values.tolist())}, wanted one number or three, none negative")
    return np.array(np.broadcast_to(values, (3,)))
