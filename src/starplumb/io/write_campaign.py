"""A campaign to its folder: ``campaign.toml`` and the CSV tables beside it, in the interface's units, nothing lost."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from starplumb import so3
from starplumb.camera import FrameCamera, LineScanCamera
from starplumb.campaign import Campaign, Detections, Landmarks
from starplumb.corrections import inertial_velocity
from starplumb.earth import C_JT, itrf_to_geodetic
from starplumb.timescales import format_iso
from starplumb.units import ARCSEC, DEG, MM, UM

from .config import CAMERA
from .markers import CARTESIAN, GEODETIC, SIGMA_ENU
from .motion import QUATERNION, SIGMA_ATTITUDE, VELOCITY
from .tables import Array, Epochs
from .write import csv_text, publish

_ALONG_AXES = 1e-6
"""Correlation that a table of three sigmas may leave out."""


def write_campaign(
    folder: Path,
    campaign: Campaign,
    *,
    time_scale: str = "UTC",
    tracker: str = "star_tracker",
    comment: str = "",
    C_EK_true: Array | None = None,
    detections: Detections | None = None,
) -> Path:
    """Write a campaign that :func:`starplumb.io.campaign.load_campaign` reads back, all files or none.

    Numbers are written with all their digits (landmark sigmas: 12) and times to the nanosecond; positions are
    in the frame of their sigmas. ``comment`` heads campaign.toml; ``C_EK_true`` is noted there as the truth
    of a simulation, which nothing but the display of results may use; ``detections`` are written in place of
    the sightings. Returns the path of campaign.toml. Raises ValueError for landmark covariances that are not
    along east, north, up, and for an attitude covariance that is not along E's axes.
    """
    files = {
        "ephemeris.csv": _ephemeris(campaign, time_scale),
        "attitude.csv": _attitude(campaign, time_scale),
        "landmarks.csv": _landmarks(campaign.landmarks),
        "images.csv": _images(campaign, time_scale),
    }
    if isinstance(campaign.camera, LineScanCamera):
        camera = campaign.camera
        files["detectors.csv"] = csv_text(
            ("column_px", "tan_x", "tan_y"), (camera.column_px, camera.tan_x, camera.tan_y)
        )
    if detections is None:
        files["observations.csv"] = _observations(campaign)
    else:
        files["detections.csv"] = _detections(campaign.images.ids, detections)
    sections = _sections(campaign, time_scale, tracker, "detections" if detections else "observations")
    if C_EK_true is not None:
        sections["truth"] = {"quaternion_xyzw": so3.to_quaternion(C_EK_true)}
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    files["campaign.toml"] = head + "\n".join(_section(name, keys) for name, keys in sections.items())
    publish(folder, files)
    return folder / "campaign.toml"


def _ephemeris(campaign: Campaign, scale: str) -> str:
    t_ns, r, v = campaign.ephemeris.t_ns, campaign.ephemeris.r_J, campaign.ephemeris.v_J
    if campaign.position_frame == "GCRF" and campaign.orientation is not None:
        C_IJ = campaign.orientation.C_IJ(t_ns)
        v = None if v is None else np.einsum("nij,nj->ni", C_IJ, inertial_velocity(r, v))
        r = np.einsum("nij,nj->ni", C_IJ, r)
    header, columns = ["time", *CARTESIAN], [_times(t_ns, scale), *r.T]
    if v is not None:
        header, columns = [*header, *VELOCITY], [*columns, *v.T]
    return csv_text(header, columns)


def _attitude(campaign: Campaign, scale: str) -> str:
    attitude = campaign.attitude
    header, columns = ["time", *QUATERNION], [_times(attitude.t_ns, scale), *attitude.q_EF.T]
    stated = _along_axes(campaign.cov_attitude_E, "the attitude's covariance is not along the axes of E")
    if stated.ndim == 2:
        order = np.argsort(campaign.images.t_ns)
        at = (attitude.t_ns - attitude.t_ns[0]) * 1e-9
        known = (campaign.images.t_ns[order] - attitude.t_ns[0]) * 1e-9
        sigmas = [np.interp(at, known, sigma) / ARCSEC for sigma in stated[order].T]
        header, columns = [*header, *SIGMA_ATTITUDE], [*columns, *sigmas]
    return csv_text(header, columns)


def _landmarks(landmarks: Landmarks) -> str:
    latitude, longitude, height = itrf_to_geodetic(landmarks.r_J)
    C = C_JT(latitude, longitude)
    exact = _along_axes(
        C.mT @ landmarks.covariance_J @ C, "a landmark's covariance is not along east, north and up"
    )
    # turning J into T and back costs a few last digits
    rounded = [[float(f"{x:.12g}") for x in row] for row in exact.tolist()]
    sigma = np.array(rounded).reshape(exact.shape)  # which an empty list has lost
    names, sigmas = (SIGMA_ENU, sigma) if np.ptp(sigma, axis=-1).any() else (("sigma_m",), sigma[:, :1])
    place = (latitude / DEG, longitude / DEG, height)
    return csv_text(("landmark_id", *GEODETIC, *names), (landmarks.ids, *place, *sigmas.T))


def _along_axes(covariance: Array, complaint: str) -> Array:
    """Sigmas (..., 3) of covariances (..., 3, 3); ValueError where more than they is in them."""
    variance = np.diagonal(covariance, axis1=-2, axis2=-1)
    left_out = covariance - variance[..., None, :] * np.eye(3)
    if np.any(np.abs(left_out) > _ALONG_AXES * np.max(variance, axis=-1)[..., None, None]):
        raise ValueError(complaint)
    return np.sqrt(variance)


def _images(campaign: Campaign, scale: str) -> str:
    images = campaign.images
    header, columns = ("image_id", "time"), (images.ids, _times(images.t_ns, scale))
    if images.line_period_s is None:
        return csv_text(header, columns)
    return csv_text((*header, "line_period_s"), (*columns, images.line_period_s))


def _observations(campaign: Campaign) -> str:
    s = campaign.sightings
    image = [campaign.images.ids[i] for i in s.image.tolist()]
    landmark = [campaign.landmarks.ids[i] for i in s.landmark.tolist()]
    header = ("image_id", "landmark_id", "column_px", "row_px", "sigma_px")
    columns = (image, landmark, s.column_px, s.row_px, s.sigma_px)
    if not s.check.any():
        return csv_text(header, columns)
    return csv_text((*header, "role"), (*columns, np.where(s.check, "check", "control").tolist()))


def _detections(images: tuple[str, ...], d: Detections) -> str:
    names = [images[i] for i in d.image.tolist()]
    return csv_text(
        ("image_id", "column_px", "row_px", "sigma_px"), (names, d.column_px, d.row_px, d.sigma_px)
    )


def _times(t_ns: Epochs, scale: str) -> list[str]:
    return format_iso(t_ns, scale, digits=9)


def _sections(campaign: Campaign, scale: str, tracker: str, measured: str) -> dict[str, Mapping[str, object]]:
    attitude = campaign.attitude
    return {
        "campaign": {"name": campaign.name, "time_scale": scale},
        "camera": _camera(campaign),
        "mounting": _mounting(campaign, tracker),
        "ephemeris": {
            "file": "ephemeris.csv",
            "frame": campaign.position_frame,
            "sigma_m": campaign.sigma_position,
        }
        | _gap(campaign.ephemeris.gap_s),
        "attitude": {"file": "attitude.csv", "from": attitude.frame, "to": tracker}
        | (
            {"sigma_arcsec": _in_unit(np.sqrt(np.diagonal(campaign.cov_attitude_E)), ARCSEC)}
            if campaign.cov_attitude_E.ndim == 2
            else {}
        )
        | _gap(attitude.gap_s),
        "landmarks": {"file": "landmarks.csv"},
        "images": {"file": "images.csv"},
        measured: {"file": f"{measured}.csv"},
        "corrections": vars(campaign.corrections),
    }


def _camera(campaign: Campaign) -> dict[str, object]:
    camera = campaign.camera
    if isinstance(camera, LineScanCamera):
        rows = int(camera.size_px[1]) if np.isfinite(camera.size_px[1]) else 1
        size = [int(camera.size_px[0]), rows]
        return {"model": "line-scan", "image_size_px": size, "look_angles": "detectors.csv"}
    if not isinstance(camera, FrameCamera):
        raise ValueError(f"a {type(camera).__name__} cannot be written")
    optics: dict[str, object] = {
        "model": "frame",
        "focal_length_mm": _in_unit(camera.focal_length, MM),
        "pixel_pitch_um": _in_unit(camera.pitch, UM),
        "image_size_px": [int(n) for n in camera.size_px],
        "principal_point_px": list(camera.principal_point_px),
    }
    if not camera.distortion.is_zero:
        optics["distortion"] = {"model": "brown-conrady", "k": camera.distortion.k, "p": camera.distortion.p}
    return optics


def _mounting(campaign: Campaign, tracker: str) -> dict[str, object]:
    keys: dict[str, object] = {
        "from": CAMERA,
        "to": tracker,
        "quaternion_xyzw": so3.to_quaternion(campaign.C_EK),
    }
    if campaign.sigma_mounting is not None:
        keys["sigma_arcsec"] = _in_unit(campaign.sigma_mounting, ARCSEC)
    return keys


def _gap(gap_s: float | None) -> dict[str, object]:
    return {} if gap_s is None else {"max_gap_s": gap_s}


def _in_unit(value: float | Array, unit: float) -> list[float] | float:
    """Numbers that, times ``unit``, give ``value`` again to the last bit where there are such, the shortest first."""
    if isinstance(value, np.ndarray):
        return [float(np.asarray(_in_unit(float(x), unit))) for x in value]
    ratio = value / unit
    near = (
        float(f"{ratio:.12g}"),
        ratio,
        float(np.nextafter(ratio, np.inf)),
        float(np.nextafter(ratio, -np.inf)),
    )
    return next((x for x in near if x * unit == value), ratio)


_COMMENTS = {
    "quaternion_xyzw": "scalar last; takes camera coordinates to the star tracker's",
    "sigma_m": "one image's markers share it",
    "image_size_px": "columns, rows",
    "principal_point_px": "column, row; (0, 0) is the centre of the first pixel",
    "aberration": "false where the attitude contains it already",
}


def _section(name: str, keys: Mapping[str, object]) -> str:
    lines = [f"{key} = {_value(value)}" for key, value in keys.items()]
    notes = [f"  # {_COMMENTS[key]}" if key in _COMMENTS else "" for key in keys]
    return "\n".join([f"[{name}]", *(line + note for line, note in zip(lines, notes, strict=True))]) + "\n"


def _value(value: object) -> str:
    """A TOML value."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(float(value))
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_value(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple | np.ndarray):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return str(value)
