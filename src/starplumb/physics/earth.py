"""The WGS84 ellipsoid: geodetic coordinates, the local level frame, the foot of a line of sight."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Float = npt.NDArray[np.float64]

WGS84_A = 6_378_137.0
"""Semi-major axis, m (NGA.STND.0036)."""
WGS84_F = 1.0 / 298.257_223_563
"""Flattening (NGA.STND.0036)."""
OMEGA_EARTH = 7.292_115e-5
"""Nominal angular velocity of the Earth, rad/s (GRS80 and WGS84; IERS Conventions 2010, table 1.2)."""

_SEMI_AXES = WGS84_A * np.array([1.0, 1.0, 1.0 - WGS84_F])


def geodetic_to_itrf(latitude: npt.ArrayLike, longitude: npt.ArrayLike, height: npt.ArrayLike) -> Float:
    """``r_J`` (..., 3) in m of geodetic latitude, longitude (rad) and height above the ellipsoid (m).

    ``r = A^2 n / |A n| + h n`` with n the upward normal and A = diag(a, a, b).
    """
    up = _up(latitude, longitude)
    foot = _SEMI_AXES**2 * up / np.linalg.norm(_SEMI_AXES * up, axis=-1, keepdims=True)
    r_J: Float = foot + np.asarray(height, dtype=float)[..., None] * up
    return r_J


def itrf_to_geodetic(r_J: npt.ArrayLike) -> tuple[Float, Float, Float]:
    """Geodetic latitude, longitude (rad), height above the ellipsoid (m), each (...,), of ``r_J`` (..., 3).

    Bowring's iteration (Survey Review 23, 1976) on the reduced latitude, tan beta = (1 - f) tan latitude:
    tan latitude = (z + e'^2 b sin^3 beta) / (rho - e^2 a cos^3 beta). Three rounds reach double precision
    from 11 km below to 40 000 km above the ellipsoid (ERFA's single round leaves 1.5 um at 700 km). NaN at
    the centre of the Earth.
    """
    x, y, z = np.moveaxis(np.asarray(r_J, dtype=float), -1, 0)
    rho = np.hypot(x, y)
    a, _, b = _SEMI_AXES
    focal2 = a * a - b * b
    tangent = z * a, rho * b  # numerator and denominator of tan beta: poles need no special case
    for _ in range(3):
        size = np.hypot(*tangent)
        with np.errstate(invalid="ignore"):
            sin_beta, cos_beta = tangent[0] / size, tangent[1] / size
        # NumPy's general power takes several times as long as two products
        up = (
            z + focal2 / b * (sin_beta * sin_beta * sin_beta),
            rho - focal2 / a * (cos_beta * cos_beta * cos_beta),
        )
        tangent = b * up[0], a * up[1]
    latitude = np.arctan2(*up)
    longitude = np.arctan2(y, x)
    return latitude, longitude, _height(r_J, _up(latitude, longitude))


def C_JT(latitude: npt.ArrayLike, longitude: npt.ArrayLike) -> Float:
    """(..., 3, 3): takes local-level coordinates (east, north, up) to ITRF; its columns are e_J, n_J, u_J."""
    lat, lon = np.broadcast_arrays(np.asarray(latitude, dtype=float), np.asarray(longitude, dtype=float))
    sin_lat, sin_lon, cos_lon = np.sin(lat), np.sin(lon), np.cos(lon)
    C = np.empty((*lat.shape, 3, 3))
    C[..., 0, 0], C[..., 1, 0], C[..., 2, 0] = -sin_lon, cos_lon, 0.0
    C[..., 0, 1], C[..., 1, 1], C[..., 2, 1] = -sin_lat * cos_lon, -sin_lat * sin_lon, np.cos(lat)
    C[..., 2] = _up(lat, lon)
    return C


def _up(latitude: npt.ArrayLike, longitude: npt.ArrayLike) -> Float:
    """The ellipsoid's upward normal ``u_J`` (..., 3)."""
    cos_lat = np.cos(latitude)
    return np.stack(
        np.broadcast_arrays(cos_lat * np.cos(longitude), cos_lat * np.sin(longitude), np.sin(latitude)),
        axis=-1,
    )


def intersect_ellipsoid(r_J: npt.ArrayLike, u_J: npt.ArrayLike, height: npt.ArrayLike = 0.0) -> Float:
    """Point (..., 3) where the ray ``r_J + s u_J``, s >= 0, comes down through geodetic ``height`` (...,) m.

    ``r_J`` and ``u_J`` (..., 3) broadcast; ``u_J`` may have any length. NaN where the ray misses the surface,
    has it behind, or starts below it.

    The surface of constant height is not an ellipsoid: it departs from the one of axes a + h, b + h, which
    starts the search, by centimetres. One step of Newton on the geodetic height removes them,
    d height / ds = n . u with n the normal at the foot.
    """
    r, u = np.asarray(r_J, dtype=float), np.asarray(u_J, dtype=float)
    h = np.asarray(height, dtype=float)
    scale = 1.0 / (_SEMI_AXES + h[..., None])
    p, d = r * scale, u * scale
    dd, pd = np.vecdot(d, d), np.vecdot(p, d)
    outside = np.vecdot(p, p) - 1.0
    discriminant = pd * pd - dd * outside
    hit = (discriminant >= 0) & (pd < 0) & (outside >= 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        s = np.where(hit, outside / (np.sqrt(discriminant) - pd), np.nan)
        point = r + s[..., None] * u
        normal = point * scale**2
        normal /= np.sqrt(np.vecdot(normal, normal))[..., None]
        s += (h - _height(point, normal)) / np.vecdot(normal, u)
    meeting: Float = r + s[..., None] * u
    return meeting


def _height(r_J: npt.ArrayLike, normal: Float) -> Float:
    """Geodetic height (...,) of points ``r_J`` (..., 3) from the ellipsoid's unit normal at their foot.

    ``h = n . r - |A n|``, the distance to the tangent plane. It is stationary in n, so that an error of
    1e-8 rad of n (the normal of the ellipsoid a + h, b + h) costs a nanometre.
    """
    stretched = _SEMI_AXES * normal
    height: Float = np.vecdot(normal, r_J) - np.sqrt(np.vecdot(stretched, stretched))
    return height
