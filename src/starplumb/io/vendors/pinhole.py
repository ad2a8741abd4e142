"""Frame images described by a pinhole: ``.tsai`` of the Ames Stereo Pipeline, and ``_pinhole.json`` of Planet's SkySat.

A ``.tsai`` has the camera's place C in ITRF and the matrix R from its axes to the Earth's; a ``_pinhole.json`` the
three matrices of ``pixel ~ P_camera P_intrinsic P_extrinsic (X, 1)``. Neither says how large the image is, and only a
name may say when it was taken. Pixels count from the centre of the first, as the pipeline counts them. Source:
StereoPipeline, "Frame camera models", and how its cam_gen reads Planet's files.
"""

from __future__ import annotations

import re
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...physics import so3, timescales
from ...physics.camera import Distortion, FrameCamera
from ...physics.errors import InputError
from ...physics.light import Corrections
from ..gis.drivers import open_raster
from ..text.files import lines_of, read_text, show
from ..text.json_node import JsonNode
from ..text.numbers import numbers
from .vendor import Detectors, Product

Array = NDArray[np.float64]

_SQUARE = 1e-6
_ORTHONORMAL = 1e-6
_PITCH_M = 1e-5
"""Of a camera whose lengths are in pixels: only their ratio matters."""
_IMAGES = (".tif", ".tiff", ".ntf", ".jp2", ".png", ".jpg")
_GPS_SECONDS = re.compile(r"(\d{9,10})\.(\d+)_")
_GPS_ORIGIN_MJD = 44_244
_APART_NS = 10**11
_PLACES = 5_000_000
"""Times of images without one: so many, from 2000 to 2015."""
_BELOW_M = 5e5
_SAME_PX = 0.01
_SAME_M = 1.0
"""Of places that a file states twice, and of pixels of one so far below."""
_RADIUS_M = (6.5e6, 5.0e7)


@dataclass(frozen=True)
class _Pinhole:
    """Focal lengths and principal point in pixels, the place (3,) m and ``C_KJ`` (3, 3) from ITRF to the camera."""

    focal_px: tuple[float, float]
    center_px: tuple[float, float]
    r_J: Array
    C_KJ: Array
    distortion: Distortion


def read_pinhole(path: Path) -> Product:
    """The image that a pinhole describes, its size that of the image file beside it.

    E is the camera's own frame and the mounting none. Raises InputError for what cannot be used.
    """
    text = read_text(path)
    pinhole = _skysat(JsonNode.of(path, text)) if text.lstrip().startswith("{") else _tsai(path, text)
    _require_sound(path, pinhole)
    image = _image(path)
    with open_raster(image) as dataset:
        columns, rows = int(dataset.width), int(dataset.height)
    t_ns, notices = _epoch(image)
    nothing = np.empty(0)
    fu, fv = pinhole.focal_px
    return Product(
        path=path,
        name=image.stem,
        columns=columns,
        rows=rows,
        detectors=Detectors(nothing, nothing, nothing),
        t_ns=t_ns,
        line_period_s=0.0,
        orbit_t_ns=np.array([t_ns]),
        r_J=pinhole.r_J[None],
        v_J=None,
        attitude_t_ns=np.array([t_ns]),
        q_EF=so3.to_quaternion(pinhole.C_KJ)[None],
        frame="ITRF",
        C_EK=np.eye(3),
        corrections=Corrections(light_time=False, aberration=False, refraction=False),
        notices=tuple(f"{path}: {notice}" for notice in notices),
        frame_camera=FrameCamera(
            0.5 * (fu + fv) * _PITCH_M,
            _PITCH_M,
            pinhole.center_px,
            (float(columns), float(rows)),
            pinhole.distortion,
        ),
    )


def _require_sound(path: Path, pinhole: _Pinhole) -> None:
    fu, fv = pinhole.focal_px
    if not (fu > 0.0 and abs(fv / fu - 1.0) < _SQUARE):
        raise InputError(f"{path}: found focal lengths of {fu:.9g} and {fv:.9g} pixels, wanted equal ones")
    off = float(np.abs(pinhole.C_KJ @ pinhole.C_KJ.mT - np.eye(3)).max())
    if not (off < _ORTHONORMAL and np.linalg.det(pinhole.C_KJ) > 0.0):
        raise InputError(f"{path}: found a matrix that is no rotation (by {off:.2g}), wanted one")
    radius, (low, high) = float(np.linalg.norm(pinhole.r_J)), _RADIUS_M
    if not low <= radius <= high:
        found = f"found the camera {radius:.7g} m from the Earth's centre"
        raise InputError(f"{path}: {found}, wanted {low / 1e3:g} to {high / 1e3:g} km in Earth-fixed axes")


def _tsai(path: Path, text: str) -> _Pinhole:
    lines = [line.strip() for line in lines_of(text) if line.strip()]
    values: dict[str, str] = {}
    for key, _, value in (line.partition("=") for line in lines if "=" in line):
        if values.setdefault(key.strip(), value) is not value:
            raise InputError(f"{path}, {key.strip()}: found it again, wanted it once")

    def several(key: str, n: int) -> Array:
        words = values.get(key, "").split()
        found = numbers(words)
        if found.size != n or not np.isfinite(found).all():
            raise InputError(f"{path}, {key}: found {show(' '.join(words))}, wanted {n} finite numbers")
        return found

    axes = np.stack([several(f"{axis}_direction", 3) for axis in "uvw"])
    if not np.array_equal(axes, np.eye(3)):
        raise InputError(f"{path}: found other directions of u, v, w than x, y, z, wanted them in R instead")
    fu, fv, cu, cv, pitch = (float(several(key, 1)[0]) for key in ("fu", "fv", "cu", "cv", "pitch"))
    if not pitch > 0.0:
        raise InputError(f"{path}, pitch: found {pitch:g}, wanted a positive number")
    lens = lines[next(i for i, line in enumerate(lines) if line.startswith("pitch")) + 1 :][:1] or ["NULL"]
    distortion = Distortion()
    if lens[0].upper() == "TSAI":
        k1, k2, p1, p2 = (float(several(key, 1)[0]) for key in ("k1", "k2", "p1", "p2"))
        k3 = float(several("k3", 1)[0]) if "k3" in values else 0.0
        distortion = Distortion((k1, k2, k3), (p1, p2))
    elif lens[0].upper() != "NULL":
        raise InputError(
            f"{path}: found the lens {show(lens[0])}, wanted NULL or TSAI (convert_pinhole_model makes it)"
        )
    return _Pinhole(
        (fu / pitch, fv / pitch),
        (cu / pitch, cv / pitch),
        several("C", 3),
        several("R", 9).reshape(3, 3).mT,
        distortion,
    )


def _skysat(node: JsonNode) -> _Pinhole:
    """The three matrices: pixels from the camera's axes, those from the body's, and those from ITRF.

    Planet's focal lengths are negative, and which way its z points does not matter: our x and y are those along which
    columns and rows grow, and our z points to the Earth. Where the file says the same twice, it must be the same.
    """
    P = node.numbers("P_camera", 3, 4) @ node.numbers("P_intrinsic", 4, 4) @ node.numbers("P_extrinsic", 4, 4)
    if not np.linalg.matrix_rank(P[:, :3]) == 3:
        raise node.error("P_camera", "a singular product with P_intrinsic and P_extrinsic", "a camera's")
    K, R, t = _parts(P)
    if t[2] < 0.0:  # the Earth's centre lies behind
        K, R, t = _parts(-P)
    pinhole = _Pinhole((K[0, 0], K[1, 1]), (K[0, 2], K[1, 2]), -R.T @ t, R, Distortion())
    if not abs(K[0, 1]) < _SQUARE * K[0, 0]:
        raise node.error(
            "P_camera", f"rows and columns {K[0, 1] / K[0, 0]:.2g} off a right angle", "square pixels"
        )
    if node.has("exterior_orientation"):
        stated = node.child("exterior_orientation")
        place = np.array([stated.number(f"{axis}_ecef_meters") for axis in "xyz"])
        if not np.linalg.norm(place - pinhole.r_J) < _SAME_M:
            wanted = f"the place that P_extrinsic has, {show(pinhole.r_J.round(3).tolist())}"
            raise node.error("exterior_orientation", place.tolist(), wanted)
    if node.has("P_projective"):
        place = np.append(pinhole.r_J + _BELOW_M * R[2], 1.0)
        (u, v, w), (a, b, c) = P @ place, node.numbers("P_projective", 3, 4) @ place
        if not (c and np.hypot(u / w - a / c, v / w - b / c) < _SAME_PX):
            raise node.error("P_projective", "another camera", "the product of the other three")
    return pinhole


def _parts(P: Array) -> tuple[Array, Array, Array]:
    """``P`` (3, 4) as a multiple of ``K (R, t)``: K triangular with a positive diagonal that ends with 1."""
    r3 = P[2, :3] / np.linalg.norm(P[2, :3])
    along = P[1, :3] - (P[1, :3] @ r3) * r3
    r2 = along / np.linalg.norm(along)
    along = P[0, :3] - (P[0, :3] @ r3) * r3 - (P[0, :3] @ r2) * r2
    R = np.stack([along / np.linalg.norm(along), r2, r3])
    K = P[:, :3] @ R.T / np.linalg.norm(P[2, :3])
    return K, R, np.linalg.solve(K, P[:, 3] / np.linalg.norm(P[2, :3]))


def _image(path: Path) -> Path:
    """The image of the same name beside the file, with an ending of its own."""
    stem = path.stem.removesuffix("_pinhole")
    for ending in _IMAGES:
        if (image := path.with_name(stem + ending)).is_file():
            return image
    raise InputError(f"{path}: found no image {stem}{_IMAGES[0]} beside it, wanted it for its size")


def _epoch(image: Path) -> tuple[int, list[str]]:
    """The time in the image's name, seconds of GPS; else one made from the name, which a notice tells: images of one
    campaign stand apart by it."""
    if found := _GPS_SECONDS.match(image.name):
        nanoseconds = int(found[1]) * 10**9 + int(found[2][:9].ljust(9, "0"))
        return int(timescales.of_count(_GPS_ORIGIN_MJD, nanoseconds, "GPS")), []
    t_ns = _APART_NS * (zlib.crc32(image.stem.encode()) % _PLACES)
    stands = timescales.format_iso(np.array([t_ns]), "UTC")[0]
    return t_ns, [f"states no time: {stands} UTC stands for it, on which nothing in the answer depends"]
