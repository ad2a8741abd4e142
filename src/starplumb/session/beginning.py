"""Folders to begin with: an empty campaign with every key explained, an editable copy of a scenario."""

from __future__ import annotations

import json
from pathlib import Path

from ..disk.publish import publish_beside
from ..documents.catalogue import schema
from ..io.campaign.config import CampaignConfig
from ..io.scenario.read import find_scenario
from ..io.tables.columns import GEODETIC, SIGMA_ENU
from ..io.text.files import read_text
from ..io.text.template import template
from ..physics.errors import InputError
from ..table.parameter_names import CLOCKS, GROUPS

IDENTITY = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
EXAMPLES: dict[str, object] = {
    "campaign.name": "first light",
    "focal_length_mm": 2200.0,
    "pixel_pitch_um": 9.0,
    "image_size_px": [12000, 12000],
    "principal_point_px": [5999.5, 5999.5],
    "look_angles": "detectors.csv",
    "window_px": [0, 0, 12000, 12000],
    "distortion": {"model": "brown-conrady", "k": [0.0, 0.0, 0.0], "p": [0.0, 0.0]},
    "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0],
    "quaternion_wxyz": [1.0, 0.0, 0.0, 0.0],
    "matrix": IDENTITY,
    "rotation_vector_deg": [0.0, 0.0, 90.0],
    "euler_deg": [0.0, 0.0, 90.0],
    "euler_order": "ZYX",
    "mounting.from": "camera",
    "mounting.to": "star_tracker",
    "cameras.name": "nadir",
    "cameras.spice": {"name": "SAT1_NADIR", "id": -999101},
    "cameras.mounting": {"from": "nadir", "to": "star_tracker", "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]},
    "mounting.sigma_arcsec": [3600.0, 3600.0, 3600.0],
    "ephemeris.file": "ephemeris.csv",
    "ephemeris.object": "SAT1",
    "ephemeris.units": {"position": "km", "velocity": "km/s"},
    "attitude.file": "attitude.csv",
    "trackers.file": "tracker_1.csv",
    "trackers.from": "GCRF",
    "trackers.to": "tracker_1",
    "trackers.mounting": {"from": "tracker_1", "to": "star_tracker", "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]},
    "attitude.from": "GCRF",
    "attitude.to": "star_tracker",
    "sigma_arcsec": [5.0, 5.0, 12.0],
    "covariance_arcsec2": [[25.0, 0.0, 0.0], [0.0, 25.0, 0.0], [0.0, 0.0, 144.0]],
    "sigma_frame": "star_tracker",
    "kernels": ["sat.tsc", "sat.tf"],
    "shared_by": "image",
    "correlation_time_s": 30.0,
    "wander": {"sigma_arcsec": [2.0, 2.0, 4.0], "correlation_time_s": 1.0},
    "fusion.frame": "star_tracker",
    "frames.from": "body",
    "frames.quaternion_xyzw": [0.0, 0.0, 0.0, 1.0],
    "spice.camera": {"name": "SAT1_CAM", "id": -999101},
    "spice.tracker": {"name": "SAT1_STR", "id": -999001},
    "spice.spacecraft_id": -999,
    "landmarks.file": "landmarks.csv",
    "imagery.files": "raw/{image_id}.tif",
    "imagery.nodata": 0.0,
    "imagery.saturation_dn": 4095.0,
    "reference.files": ["ortho/*.tif"],
    "reference.nodata": 0.0,
    "reference.dem": "dem.tif",
    "reference.sigma_m": [0.5, 0.5, 3.0],
    "dem": "dem.tif",
    "geoid": "geoid.tif",
    "crs": "EPSG:32633",
    "consider.focal_length": "5um",
    **dict.fromkeys([f"consider.principal_{of}" for of in ("point", "column", "row")], "0.4px"),
    **dict.fromkeys([f"consider.{name}" for name in ("distortion", "k1", "k2", "k3", "p1", "p2")], "0.01"),
    **dict.fromkeys([f"consider.{name}" for name in ("look_angles", *GROUPS["look_angles"])], "0.4px"),
    **dict.fromkeys([f"consider.{name}" for name in CLOCKS], "2ms"),
    "consider.trackers": "5arcsec",
    "consider.refraction": "10%",
    "images.file": "images.csv",
    "time_from_id": "SAT1_%Y%m%dT%H%M%S.%fZ_L1A",
    "observations.file": "observations.csv",
    "detections.file": "detections.csv",
    "orientation_file": "finals2000A.all",
    "columns": {"time": "epoch"},
    "keep": {"mode": "FINE"},
    "time": {"column": "unix_time", "format": "unix"},
}
"""Values of the empty campaign; a key that is not among them has one of its type."""
ACTIVE = (
    *(
        f"camera.{key}"
        for key in ("focal_length_mm", "pixel_pitch_um", "image_size_px", "principal_point_px")
    ),
    "mounting.quaternion_xyzw",
    *(f"attitude.{key}" for key in ("file", "from", "to", "sigma_arcsec")),
    "images.file",
    "observations.file",
)
"""What a campaign of a frame camera and a star tracker needs beyond the keys that every campaign has."""
TABLES = {
    "ephemeris.csv": ("time", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s"),
    "attitude.csv": ("time", "qx", "qy", "qz", "qw"),
    "landmarks.csv": ("landmark_id", *GEODETIC, *SIGMA_ENU),
    "images.csv": ("image_id", "time"),
    "observations.csv": ("image_id", "landmark_id", "column_px", "row_px", "sigma_px"),
}
HEAD = """\
# A campaign: fill in the values and the tables, then run: starplumb check campaign.toml
# Every key stands here with what it may be; those that may be left out are commented out."""


def write_template(folder: Path) -> Path:
    """Write a campaign without data, every key explained, and tables without rows; the path of ``campaign.toml``."""
    text = template(CampaignConfig, EXAMPLES, ACTIVE, f"{schema_line('campaign')}\n{HEAD}")
    tables = {name: ",".join(columns) + "\n" for name, columns in TABLES.items()}
    publish_beside(folder, {**tables, "campaign.schema.json": schema_text("campaign"), "campaign.toml": text})
    return folder / "campaign.toml"


def write_scenario(folder: Path, name: str) -> Path:
    """Write a copy of a scenario that can be edited; the path of the file.

    Raises InputError for a scenario that there is not.
    """
    source = find_scenario(name)
    files = {"scenario.toml": f"{schema_line('scenario')}\n{read_text(source)}"}
    publish_beside(folder, {"scenario.schema.json": schema_text("scenario"), **files})
    return folder / "scenario.toml"


def schema_line(name: str) -> str:
    """The line by which editors find the schema of a document beside it."""
    return f"#:schema {name}.schema.json"


def schema_text(name: str) -> str:
    """The JSON schema of a document as the text of its file."""
    return json.dumps(schema(name), indent=1, ensure_ascii=False) + "\n"


def require_new(folder: Path) -> None:
    """Raise InputError where there is something already."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: found something there already, wanted a new or empty folder")
