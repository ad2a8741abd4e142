"""What was flown and what came of it, at a glance: dates, camera, stated errors, and the correction in the camera's
axes as angle, pixels and metres."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...judge.calibrate import Calibration
from ...physics.camera import FrameCamera, LineScanCamera
from ...physics.timescales import format_iso
from ...physics.units import ARCSEC
from ..page import Table
from ..text import length, number

Array = NDArray[np.float64]
Document = Mapping[str, Any]

ALONG = 0.9
"""Cosine between the flight and an axis of the camera from which on the turns have the names of flight."""


def facts(c: Calibration, document: Document) -> Table:
    """Acquisition, camera and ground in a table of words."""
    rows = [
        ("acquired", _dates(c)),
        ("images", _images(document)),
        ("camera", camera_words(c.campaign.camera)),
        ("distance to the markers", length(_range(c))),
        (
            "pixel on the ground",
            f"{length(_range(c) * pixel_rad(c.campaign.camera))} across the line of sight",
        ),
        ("sightings", _sightings(c)),
    ]
    return Table("Acquisition and camera", ("what", "value"), rows, text_columns=2)


def _dates(c: Calibration) -> str:
    t_ns = c.campaign.images.t_ns
    first, last = format_iso(np.array([t_ns.min(), t_ns.max()]), "UTC", 0)
    return f"{first} UTC" if first == last else f"{first} to {last} UTC"


def _images(document: Document) -> str:
    used = [i for i in document["images"] if i["observations"] > 0]
    passes = len({(i.get("session"), i.get("pass")) for i in used})
    return f"{len(used)} in {passes} pass{'es' * (passes != 1)}"


def _sightings(c: Calibration) -> str:
    used, check = c.residuals.used, c.campaign.sightings.check
    rejected = int(np.sum(~used & ~check))
    return f"{int(np.sum(used))} in the solution, {int(np.sum(check))} to check it, {rejected} rejected"


def camera_words(camera: object) -> str:
    """The camera in a line: what it is, its focal length and pitch where these are stated, its pixels."""
    if isinstance(camera, FrameCamera):
        columns, rows = camera.size_px
        return (
            f"frame, focal length {number(camera.focal_length, 4)} m, pitch {number(1e6 * camera.pitch)} µm, "
            f"{columns:g} x {rows:g} px, {number(pixel_rad(camera) / ARCSEC)} arcsec a pixel"
        )
    if isinstance(camera, LineScanCamera):
        return (
            f"line scanner, {camera.size_px[0]:g} columns, {number(camera.pixel_rad / ARCSEC)} arcsec a pixel"
        )
    return type(camera).__name__


def pixel_rad(camera: Any) -> float:
    """Angle of a pixel, rad."""
    return float(camera.pitch / camera.focal_length if isinstance(camera, FrameCamera) else camera.pixel_rad)


def _range(c: Calibration) -> float:
    """Mean distance from the camera to the markers it sees, m."""
    o = c.observations
    return float(np.mean(np.linalg.norm(o.p_J - o.r_J, axis=-1)))


def in_the_camera(c: Calibration) -> tuple[Table, ...]:
    """The correction and its sigma about the camera's axes; turns are named after flight where an axis is along it."""
    if not c.status.usable:
        return ()
    C_KE = c.campaign.C_EK.mT
    turn_K = C_KE @ c.correction_E
    covariance_E = c.covariance_E
    sigma_K = None if covariance_E is None else np.sqrt(np.diagonal(C_KE @ covariance_E @ C_KE.mT))
    far = _range(c)
    px = 1.0 / pixel_rad(c.campaign.camera)
    levers = np.array([1.0, 1.0, _corner_rad(c)])
    rows = [
        (
            name,
            *_pair(turn_K, sigma_K, i, 1.0 / ARCSEC),
            *_pair(turn_K, sigma_K, i, px * levers[i]),
            *_pair(turn_K, sigma_K, i, far * levers[i]),
        )
        for i, name in enumerate(_names(c))
    ]
    head = ("turn", "arcsec", "sigma", "pixels", "sigma", "metres", "sigma")
    note = (
        f"Pixels and metres at {length(far)}, across the line of sight: of the turn about the boresight at the corner "
        "of the image, of the others everywhere. The sigma is that of the stated errors."
    )
    return (Table("The correction about the camera's axes", head, rows, note=note),)


def _pair(turn: Array, sigma: Array | None, i: int, scale: float) -> tuple[str, str]:
    return number(float(turn[i] * scale), 4), number(None if sigma is None else float(sigma[i] * scale))


def _corner_rad(c: Calibration) -> float:
    """Angle from the boresight to the farthest sighting."""
    return float(np.max(np.hypot(*c.observations.xy_K.mT)))


def _names(c: Calibration) -> tuple[str, str, str]:
    """Roll is about the axis of flight, pitch about that across it, yaw about the boresight."""
    o = c.observations
    v_K = (o.C_EJ @ o.v_J[..., None])[..., 0] @ c.campaign.C_EK
    along = np.mean(v_K / np.maximum(np.linalg.norm(v_K, axis=-1, keepdims=True), 1e-300), axis=0)
    if abs(along[1]) > ALONG:
        return "pitch (x)", "roll (y)", "yaw (z)"
    if abs(along[0]) > ALONG:
        return "roll (x)", "pitch (y)", "yaw (z)"
    return "about x (along a row)", "about y (down a column)", "about z (boresight)"
