"""A product in a vendor's format, made up from a known scene.

Real products may not be passed on, so this script makes one: the files `.IMD`, `.ATT`, `.EPH` and `.GEO` of a
line scanner over its calibration site, as DigitalGlobe delivers them, the tables of markers that an analyst
would add, and the true mounting, which the `.GEO` misses by some minutes of arc. The tutorial starts from
these files.
"""

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from _scene import EARTH, EPOCH_NS, ORBIT

from starplumb.physics import so3
from starplumb.physics.camera import LineScanCamera
from starplumb.physics.earth import geodetic_to_itrf, itrf_to_geodetic
from starplumb.physics.light import Corrections
from starplumb.physics.timescales import format_iso
from starplumb.physics.units import ARCMIN, ARCSEC, DEG
from starplumb.plan import scene
from starplumb.table.geometry import locate, observe
from starplumb.table.simulate import Errors

COLUMNS, ROWS, PERIOD_S = 8000, 9000, 1.1e-4
DISTANCE_MM, PITCH_MM = 8800.0, 0.012
TURN = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""From our camera axes K to the vendor's V, x along the flight and y along the line of detectors: C_VK."""
SIGMAS = scene.Sigmas(np.full(3, 2.0 * ARCSEC), np.full(3, 0.5), np.array([0.3, 0.3, 0.5]), 0.25)
FOLDER = Path("product")


def main() -> None:
    rng = np.random.default_rng(12)
    C_EK_true = so3.exp(np.array([6.0, -9.0, 4.0]) * ARCMIN) @ TURN
    camera = LineScanCamera.from_optics(
        1e-3 * DISTANCE_MM, 1e-3 * PITCH_MM, ((COLUMNS - 1) / 2, 0.0), COLUMNS, rows=ROWS
    )
    truth = photograph(camera, C_EK_true)
    pixel = np.stack([rng.uniform(100, COLUMNS - 100, 25), rng.uniform(100, ROWS - 100, 25)], axis=-1)
    truth = scene.mark_pixels(truth, np.zeros(25, dtype=int), pixel, rng.uniform(0.0, 400.0, 25), SIGMAS)
    corners = np.array([[0, 0], [COLUMNS - 1, 0], [COLUMNS - 1, ROWS - 1], [0, ROWS - 1]], dtype=float)
    places = locate(truth, C_EK_true, np.zeros(4, dtype=int), *corners.T, 0.0)
    measured = scene.measured(truth, Errors.draw(observe(truth), rng), TURN)
    FOLDER.mkdir(exist_ok=True)
    write_imd(measured.images.t_ns[0], places)
    write_series(measured)
    write_geo()
    write_markers(measured)
    np.savetxt("true-mounting.txt", so3.to_quaternion(C_EK_true)[None], header="camera to body, x y z w")
    print("\n".join(sorted(str(path) for path in FOLDER.iterdir())))
    draw(measured)


def photograph(camera: LineScanCamera, C_EK_true: np.ndarray) -> object:
    """One scan straight down, with an Earth-fixed attitude at 50 samples a second as the vendor gives it."""
    middle = np.array([0.0])
    r_J, _ = scene.fly(ORBIT, EARTH, EPOCH_NS, middle)
    latitude, longitude, _ = itrf_to_geodetic(r_J)
    aim_J = geodetic_to_itrf(latitude, longitude, 0.0)
    flight = scene.Pass(middle, aim_J, np.array([np.pi]))
    campaign = scene.photograph(
        camera, ORBIT, EARTH, EPOCH_NS, flight, C_EK_true, SIGMAS, Corrections(), PERIOD_S
    )
    C_EJ, _ = campaign.attitude.at(campaign.attitude.t_ns)
    fixed = replace(campaign.attitude, q_EF=so3.to_quaternion(C_EJ), frame="ITRF", orientation=None)
    return replace(campaign, attitude=fixed)


def listed(name: str, rows: list[list[float]]) -> str:
    text = ",\n".join("(" + ", ".join(f"{value:.16g}" for value in row) + ")" for row in rows)
    return f"{name} = (\n{text} );\n"


def iso(t_ns: int) -> str:
    return format_iso(np.array([t_ns]), "UTC", digits=6)[0] + "Z"


def write_imd(t_ns: int, places: np.ndarray) -> None:
    """Size, timing and corners of the image."""
    latitude, longitude, height = itrf_to_geodetic(places)
    keys = [
        f"{name}{key} = {value:.10f};"
        for i, name in enumerate(("UL", "UR", "LR", "LL"))
        for key, value in (("Lon", longitude[i] / DEG), ("Lat", latitude[i] / DEG), ("HAE", height[i]))
    ]
    lines = [
        'bandId = "P";',
        f"numRows = {ROWS};",
        f"numColumns = {COLUMNS};",
        "BEGIN_GROUP = BAND_P",
        *keys,
        "END_GROUP = BAND_P",
        "BEGIN_GROUP = IMAGE_1",
        'catId = "MADEUP01";',
        f"firstLineTime = {iso(t_ns)};",
        f"avgLineRate = {1.0 / PERIOD_S:.6f};",
        f"TLCTime = {iso(t_ns)};",
        listed("TLCList", [[0, 0.0], [ROWS, ROWS * PERIOD_S]]).rstrip(),
        'positionKnowledgeSrc = "R";',
        'attitudeKnowledgeSrc = "R";',
        "END_GROUP = IMAGE_1",
        "END;",
    ]
    (FOLDER / "MADEUP01.IMD").write_text("\n".join(lines) + "\n")


def write_series(campaign: object) -> None:
    """Attitude (body to ITRF, scalar last) and orbit, each row with its covariance."""
    t_ns = campaign.attitude.t_ns
    q = campaign.attitude.q_EF * np.array([-1.0, -1.0, -1.0, 1.0])
    r_J, v_J = campaign.ephemeris.at(t_ns)
    upper = np.triu_indices(4)
    attitude = [[i + 1, *row, *quaternion_covariance(row)[upper]] for i, row in enumerate(q)]
    variance = np.diag(SIGMAS.position**2)[np.triu_indices(3)]
    orbit = [[i + 1, *r, *v, *variance] for i, (r, v) in enumerate(zip(r_J, v_J, strict=True))]
    step = 1e-9 * (t_ns[1] - t_ns[0])
    head = f"startTime = {iso(t_ns[0])};\ntimeInterval = {step:.6f};\nnumPoints = {t_ns.size};\n"
    (FOLDER / "MADEUP01.ATT").write_text(head + listed("attList", attitude) + "END;\n")
    (FOLDER / "MADEUP01.EPH").write_text(head + listed("ephemList", orbit) + "END;\n")


def quaternion_covariance(q: np.ndarray) -> np.ndarray:
    """P = G^T S G / 4 of small angles with covariance S, the inverse of S = 4 G P G^T."""
    v, w = q[:3], q[3]
    G = np.concatenate([w * np.eye(3) - so3.skew(v), -v[:, None]], axis=-1)
    return 0.25 * G.T @ np.diag(SIGMAS.attitude**2) @ G


def write_geo() -> None:
    """Optics and the mounting known before launch: the body's axes are the camera's."""
    origin_y = 0.5 * (COLUMNS - 1) * PITCH_MM
    text = f"""BEGIN_GROUP = PRINCIPAL_DISTANCE
 pd = {DISTANCE_MM};
END_GROUP = PRINCIPAL_DISTANCE
BEGIN_GROUP = PERSPECTIVE_CENTER
 cx = 0.0; cy = 0.0; cz = 0.0;
END_GROUP = PERSPECTIVE_CENTER
BEGIN_GROUP = CAMERA_ATTITUDE
 qcs1 = 0.0; qcs2 = 0.0; qcs3 = 0.0; qcs4 = 1.0;
END_GROUP = CAMERA_ATTITUDE
BEGIN_GROUP = DETECTOR_MOUNTING
 BEGIN_GROUP = BAND_P
  BEGIN_GROUP = DETECTOR_ARRAY_1
   detOriginX = 0.0; detOriginY = {origin_y:.6f}; detRotAngle = 0.0; detPitch = {PITCH_MM};
  END_GROUP = DETECTOR_ARRAY_1
 END_GROUP = BAND_P
END_GROUP = DETECTOR_MOUNTING
END;
"""
    (FOLDER / "MADEUP01.GEO").write_text(text)


def write_markers(campaign: object) -> None:
    """What the analyst adds: surveyed markers and where they were found in the image; five are kept for checking."""
    latitude, longitude, height = itrf_to_geodetic(campaign.landmarks.r_J)
    rows = [
        f"{name},{lat:.9f},{lon:.9f},{h:.3f},0.3,0.3,0.5"
        for name, lat, lon, h in zip(
            campaign.landmarks.ids, latitude / DEG, longitude / DEG, height, strict=True
        )
    ]
    head = "landmark_id,latitude_deg,longitude_deg,height_m,sigma_east_m,sigma_north_m,sigma_up_m"
    Path("landmarks.csv").write_text("\n".join([head, *rows]) + "\n")
    s = campaign.sightings
    rows = [
        f"MADEUP01,{name},{column:.3f},{row:.3f},0.25,{'check' if i >= 20 else 'control'}"
        for i, (name, column, row) in enumerate(
            zip(campaign.landmarks.ids, s.column_px, s.row_px, strict=True)
        )
    ]
    head = "image_id,landmark_id,column_px,row_px,sigma_px,role"
    Path("observations.csv").write_text("\n".join([head, *rows]) + "\n")


def draw(campaign: object) -> None:
    figure, axis = plt.subplots(figsize=(4.2, 4.2), layout="constrained")
    axis.plot(campaign.sightings.column_px, campaign.sightings.row_px, "o")
    axis.set(
        xlim=(0, COLUMNS),
        ylim=(ROWS, 0),
        xlabel="column, px",
        ylabel="row, px",
        title="where the markers were found",
    )
    figure.savefig("product.svg")


if __name__ == "__main__":
    main()
