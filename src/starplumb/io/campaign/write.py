"""A campaign to its folder: ``campaign.toml`` and the CSV tables beside it, in the interface's units, nothing lost."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...disk.publish import publish, publish_beside
from ...physics import so3
from ...physics.camera import Camera, FrameCamera, LineScanCamera
from ...physics.earth import C_JT, itrf_to_geodetic
from ...physics.light import inertial_velocity
from ...physics.orientation import C_IF
from ...physics.units import ARCSEC, DEG, MM, UM
from ...table.cameras.views import of_camera
from ...table.campaign import Campaign, Detections, Landmarks
from ...table.considered import REFRACTION
from ...table.parameter_names import UNITS, unit_of
from ..tables.cells import Array
from ..tables.columns import CARTESIAN, GEODETIC, SIGMA_ENU
from ..text.write import Column, csv_text
from .fixed_frames import CAMERA
from .marks.markers import noise_columns
from .motion import VELOCITY
from .toml_text import Sections, document_text, in_unit
from .write_attitude import along_axes, attitude_files, attitude_sections, gap, shared, times

_ROW_TIMES = "row_times_{}.csv"
"""The table of uneven rows of the image of an index."""


def write_campaign(
    folder: Path,
    campaign: Campaign,
    *,
    time_scale: str = "UTC",
    tracker: str = "star_tracker",
    comment: str = "",
    C_EK_true: Array | None = None,
    detections: Detections | None = None,
    schema: str = "",
    new: bool = False,
) -> Path:
    """Write a campaign that :func:`starplumb.io.campaign.read.load_campaign` reads back, all files or none.

    Numbers are written with all their digits (landmark sigmas: 12) and times to the nanosecond; positions are in
    the frame of their sigmas. ``comment`` heads campaign.toml; ``C_EK_true`` is noted there as the truth of a
    simulation, which nothing but the display of results may use; ``detections`` are written in place of the
    sightings; ``schema`` is a JSON schema to lie beside campaign.toml. Returns the path of campaign.toml. Raises
    InputError where the campaign must be ``new`` and a file of it is there already, ValueError for landmark
    covariances that are not along east, north, up, and for an attitude covariance that is not along E's axes.
    """
    files = campaign_files(campaign, time_scale, detections)
    sections = campaign_sections(
        campaign, time_scale, tracker, "detections" if detections else "observations"
    )
    if C_EK_true is not None:
        sections = [*sections, ("truth", {"quaternion_xyzw": so3.to_quaternion(C_EK_true)})]
    text = document_text(sections, comment)
    if schema:
        text = f"#:schema campaign.schema.json\n{text}"
        files["campaign.schema.json"] = schema
    write = publish_beside if new else publish
    write(folder, files | {"campaign.toml": text})  # last: it marks that the tables are there
    return folder / "campaign.toml"


def campaign_files(
    campaign: Campaign, time_scale: str, detections: Detections | None = None
) -> dict[str, str]:
    """The tables of a campaign by the names of their files."""
    files = {
        "ephemeris.csv": _ephemeris(campaign, time_scale),
        **attitude_files(campaign, time_scale),
        "landmarks.csv": landmarks_text(campaign.landmarks),
        "images.csv": _images(campaign, time_scale),
        **_row_times(campaign, time_scale),
    }
    for camera, name in _cameras(campaign):
        if isinstance(camera, LineScanCamera):
            files[name] = csv_text(
                ("column_px", "tan_x", "tan_y"), (camera.column_px, camera.tan_x, camera.tan_y)
            )
    if detections is None:
        files["observations.csv"] = _observations(campaign)
    else:
        files["detections.csv"] = _detections(campaign.images.ids, detections)
    return files


def _ephemeris(campaign: Campaign, scale: str) -> str:
    t_ns, r, v = campaign.ephemeris.t_ns, campaign.ephemeris.r_J, campaign.ephemeris.v_J
    if campaign.position_frame != "ITRF" and campaign.orientation is not None:
        C_IJ = campaign.orientation.C_IJ(t_ns)
        if campaign.position_frame != "GCRF":
            C_IJ = C_IF(campaign.position_frame, t_ns).mT @ C_IJ
        v = None if v is None else np.einsum("nij,nj->ni", C_IJ, inertial_velocity(r, v))
        r = np.einsum("nij,nj->ni", C_IJ, r)
    header, columns = ["time", *CARTESIAN], [times(t_ns, scale), *r.mT]
    if v is not None:
        header, columns = [*header, *VELOCITY], [*columns, *v.mT]
    return csv_text(header, columns)


def landmarks_text(landmarks: Landmarks) -> str:
    """The table of landmarks.  Raises ValueError for covariances that are not along east, north and up."""
    latitude, longitude, height = itrf_to_geodetic(landmarks.r_J)
    C = C_JT(latitude, longitude)
    exact = along_axes(
        C.mT @ landmarks.covariance_J @ C, "a landmark's covariance is not along east, north and up"
    )
    # turning J into T and back costs a few last digits
    rounded = [[float(f"{x:.12g}") for x in row] for row in exact.tolist()]
    sigma = np.array(rounded).reshape(exact.shape)  # which an empty list has lost
    names, sigmas = (
        (SIGMA_ENU, sigma)
        if np.ptp(sigma[landmarks.surveyed], axis=-1).any()
        else (("sigma_m",), sigma[:, :1])
    )
    tie = ~landmarks.surveyed
    place = (np.ma.array(x, mask=tie) for x in (latitude / DEG, longitude / DEG, height))
    sigmas = np.where(tie[:, None], np.inf, sigmas)
    header, columns = ["landmark_id", *GEODETIC, *names], [landmarks.ids, *place, *sigmas.mT]
    if landmarks.sources is not None:
        header, columns = [*header, "source"], [*columns, landmarks.sources]
    return csv_text(header, columns)


def _common(landmarks: Landmarks) -> dict[str, object]:
    """The keys about what the landmarks of a survey share, where it is stated."""
    shared = {"common_sigma_m": landmarks.common_sigma, "correlation_length_m": landmarks.correlation_length}
    return {key: value for key, value in shared.items() if value is not None}


def _considered(campaign: Campaign) -> Sections:
    """The section [consider], where something is."""
    if not campaign.considered:
        return []
    return [("consider", {name: _with_unit(name, sigma) for name, sigma in campaign.considered})]


def _with_unit(name: str, sigma: float) -> str:
    if name == REFRACTION:
        return f"{in_unit(sigma, 0.01)!r}%"
    unit = unit_of(name)
    return f"{in_unit(sigma, UNITS[unit])!r}{unit}"


def _images(campaign: Campaign, scale: str) -> str:
    images = campaign.images
    columns: dict[str, Sequence[object]] = {"image_id": images.ids, "time": times(images.t_ns, scale)}
    if images.row_times is not None and None not in images.row_times:
        columns["row_times"] = [_ROW_TIMES.format(i) for i in range(len(images.ids))]
    elif images.line_period_s is not None:
        columns["line_period_s"] = images.line_period_s.tolist()
    for name, texts in (
        ("camera", images.camera),
        ("tracker", images.tracker),
        ("pass", images.passes),
        ("session", images.sessions),
    ):
        if texts is not None:
            columns[name] = texts
    if images.sigma_time_s is not None:
        columns["sigma_time_s"] = images.sigma_time_s.tolist()
    columns |= {f"temperature_{name}_c": values.tolist() for name, values in images.temperatures.items()}
    return csv_text(tuple(columns), tuple(columns.values()))


def _row_times(campaign: Campaign, scale: str) -> dict[str, str]:
    """The tables of uneven rows by the names of their files."""
    images = campaign.images
    return {
        _ROW_TIMES.format(i): csv_text(
            ("row", "time"), (table.row, times(images.t_ns[i] + table.late_ns, scale))
        )
        for i, table in enumerate(images.row_times or ())
        if table is not None
    }


def _observations(campaign: Campaign) -> str:
    s = campaign.sightings
    image = [campaign.images.ids[i] for i in s.image.tolist()]
    landmark = [campaign.landmarks.ids[i] for i in s.landmark.tolist()]
    sigma, noise = noise_columns(s)
    header = ("image_id", "landmark_id", "column_px", "row_px", *sigma)
    columns: tuple[Column, ...] = (image, landmark, s.column_px, s.row_px, *noise)
    if not s.check.any():
        return csv_text(header, columns)
    return csv_text((*header, "role"), (*columns, np.where(s.check, "check", "control").tolist()))


def _detections(images: tuple[str, ...], d: Detections) -> str:
    names = [images[i] for i in d.image.tolist()]
    sigma, noise = noise_columns(d)
    return csv_text(("image_id", "column_px", "row_px", *sigma), (names, d.column_px, d.row_px, *noise))


def campaign_sections(
    campaign: Campaign, scale: str, tracker: str = "star_tracker", measured: str = "observations"
) -> Sections:
    """The sections of a campaign.toml whose tables are those of :func:`campaign_files`."""
    ephemeris = {
        "file": "ephemeris.csv",
        "frame": campaign.position_frame,
        "sigma_m": campaign.sigma_position,
        **shared(campaign.position_errors, 1.0, "session_sigma_m"),
    }
    return [
        ("campaign", {"name": campaign.name, "time_scale": scale}),
        *_optics(campaign, tracker),
        ("ephemeris", ephemeris | gap(campaign.ephemeris.gap_s)),
        *attitude_sections(campaign, tracker),
        ("landmarks", {"file": "landmarks.csv"} | _common(campaign.landmarks)),
        ("images", {"file": "images.csv"}),
        (measured, {"file": f"{measured}.csv"}),
        *_considered(campaign),
        ("corrections", vars(campaign.corrections)),
    ]


def _cameras(campaign: Campaign) -> list[tuple[Camera, str]]:
    """Every camera, and the name of its table of look directions."""
    if campaign.rig is None:
        return [(campaign.camera, "detectors.csv")]
    names = (f"detectors_{name}.csv" for name in campaign.rig.names)
    return list(zip(campaign.rig.cameras, names, strict=True))


def _optics(campaign: Campaign, tracker: str) -> Sections:
    """[camera] and [mounting], or [[cameras]]."""
    rig, tables = campaign.rig, _cameras(campaign)
    if rig is None:
        return [("camera", _camera(*tables[0])), ("mounting", _mounting(campaign, tracker))]
    mountings = (_mounting(of_camera(campaign, k), tracker) for k in range(len(rig.names)))
    return [
        ("[cameras]", {"name": name, **_camera(*table), "mounting": mounting | {"from": name}})
        for name, table, mounting in zip(rig.names, tables, mountings, strict=True)
    ]


def _camera(camera: Camera, table: str) -> dict[str, object]:
    if isinstance(camera, LineScanCamera):
        rows = int(camera.size_px[1]) if np.isfinite(camera.size_px[1]) else 1
        size = [int(camera.size_px[0]), rows]
        return {"model": "line-scan", "image_size_px": size, "look_angles": table}
    if not isinstance(camera, FrameCamera):
        raise ValueError(f"a {type(camera).__name__} cannot be written")
    optics: dict[str, object] = {
        "model": "frame",
        "focal_length_mm": in_unit(camera.focal_length, MM),
        "pixel_pitch_um": in_unit(camera.pitch, UM),
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
        keys["sigma_arcsec"] = in_unit(campaign.sigma_mounting, ARCSEC)
    return keys
