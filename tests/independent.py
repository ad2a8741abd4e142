"""A second simulator, written from the interface alone: scipy rotations, ERFA frames and aberration, CSV text.

It shares no line with the package, so that a convention misread there cannot be misread here in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import astropy_iers_data
import erfa
import numpy as np
from scipy.spatial.transform import Rotation

C = 299_792_458.0
ARCSEC = np.pi / 648_000.0
OMEGA = 7.292115e-5
START = datetime(2025, 3, 10, 10, 0, 0)
UTC_TO = {"UTC": 0.0, "TAI": 37.0, "GPS": 18.0, "TT": 69.184}
"""Seconds ahead of UTC in 2025."""
TILTS_DEG = [(3, -5), (0, 8), (-6, 2), (9, 9), (-9, 0)]


@dataclass(frozen=True)
class Case:
    """What the files of a campaign state and how."""

    model: str = "frame"
    direction: str = "to tracker"
    scale: str = "UTC"
    origin: str = "center"
    aberration: bool = True
    line_offset_px: float = 0.0


def _orientation_parameters(mjd: float) -> tuple[float, float, float]:
    """Pole (arcsec) and UT1-UTC (s), linear between the days of Bulletin A."""
    with Path(astropy_iers_data.IERS_A_FILE).open() as file:
        rows = [line for line in file if line[58:68].strip()]
    days = [float(line[7:15]) for line in rows]
    return tuple(
        np.interp(mjd, days, [float(line[a:b]) for line in rows]) for a, b in ((18, 27), (37, 46), (58, 68))
    )


X_POLE, Y_POLE, DUT1 = _orientation_parameters(60744 + 10 / 24)


def c_ij(t: float) -> np.ndarray:
    """Inertial from Earth-fixed, without the small dX, dY (0.0003 arcsec)."""
    d = START + timedelta(seconds=t)
    utc = erfa.dtf2d("UTC", d.year, d.month, d.day, d.hour, d.minute, d.second + d.microsecond * 1e-6)
    tt = erfa.taitt(*erfa.utctai(*utc))
    return erfa.c2t06a(*tt, *erfa.utcut1(*utc, DUT1), X_POLE * ARCSEC, Y_POLE * ARCSEC).T


def orbit(t: float) -> tuple[np.ndarray, np.ndarray]:
    a, i, node = 7050e3, np.radians(98.0), 0.5
    n = np.sqrt(3.986004418e14 / a**3)
    u = 0.7 + n * t
    p = np.array([np.cos(node), np.sin(node), 0.0])
    q = np.array([-np.sin(node) * np.cos(i), np.cos(node) * np.cos(i), np.sin(i)])
    return a * (np.cos(u) * p + np.sin(u) * q), a * n * (-np.sin(u) * p + np.cos(u) * q)


def camera_attitude(image: int, t0: float, t: float) -> np.ndarray:
    """Inertial from camera: tilted off the nadir, turned about the boresight, carried round with the orbit."""
    r, v = orbit(t0)
    z = -r / np.linalg.norm(r)
    y = v - (v @ z) * z
    y /= np.linalg.norm(y)
    start = np.stack([np.cross(y, z), y, z], axis=1)
    turn = Rotation.from_euler("xyz", [*TILTS_DEG[image], 40 * image], degrees=True).as_matrix()
    rate = np.cross(r, v) / (r @ r)
    return Rotation.from_rotvec(rate * (t - t0)).as_matrix() @ start @ turn


def ground_point(
    r_I: np.ndarray, v_I: np.ndarray, seen_I: np.ndarray, t: float, height: float, aberration: bool
):
    """Geodetic longitude, latitude and height whose light arrives along ``seen_I``."""
    e = seen_I.copy()
    for _ in range(5 if aberration else 0):
        e += seen_I - erfa.ab(e, v_I / C, 1e99, np.sqrt(1.0 - v_I @ v_I / C**2))
        e /= np.linalg.norm(e)
    frame, tau = c_ij(t), 680e3 / C
    for _ in range(4):
        since = Rotation.from_rotvec(
            [0.0, 0.0, OMEGA * tau]
        ).as_matrix()  # turn of the Earth while the light flies
        a, b = since @ frame.T @ r_I, since @ frame.T @ e
        s0, s1 = 650e3, 660e3
        for _ in range(30):  # secant
            h0, h1 = (erfa.gc2gd(1, a + s * b)[2] - height for s in (s0, s1))
            if abs(h1) < 1e-7 or h1 == h0:
                break
            s0, s1 = s1, s1 - h1 * (s1 - s0) / (h1 - h0)
        tau = s1 / C
    return erfa.gc2gd(1, a + s1 * b)


def _table(path: Path, header: str, rows: list[list[object]]) -> None:
    text = [",".join(cell if isinstance(cell, str) else repr(float(cell)) for cell in row) for row in rows]
    path.write_text("\n".join([header, *text]) + "\n")


def write(folder: Path, case: Case, rng: np.random.Generator) -> np.ndarray:
    """Write a campaign without errors and return the true C_EK; its model mounting is off by half a degree."""
    C_EK = Rotation.from_rotvec([0.02, -0.5, 1.3]).as_matrix()
    model = Rotation.from_rotvec([0.01, -0.004, 0.006]).as_matrix() @ C_EK
    focal, pitch, period = 1.8, 8e-6, 5e-4
    scan, shift = case.model == "line-scan", 0.5 if case.origin == "corner" else 0.0
    tables: dict[str, list[list[object]]] = {name: [] for name in ("eph", "att", "img", "lm", "obs")}

    def iso(t: float) -> str:
        return (START + timedelta(seconds=float(t) + UTC_TO[case.scale])).isoformat(timespec="microseconds")

    for image in range(5):
        t0 = 20.0 * image
        tables["img"].append([f"i{image}", iso(t0), *([period] if scan else [])])
        for t in t0 + np.arange(-2.0, 2.001, 0.25):
            r_I, v_I = orbit(t)
            r_J = c_ij(t).T @ r_I
            v_J = c_ij(t).T @ v_I - np.cross([0.0, 0.0, OMEGA], r_J)
            tables["eph"].append([iso(t), *r_J, *v_J])
            C_EI = C_EK @ camera_attitude(image, t0, t).T
            q = Rotation.from_matrix(C_EI if case.direction == "to tracker" else C_EI.T).as_quat()
            tables["att"].append([iso(t), *(q * rng.choice([-1.0, 1.0]))])
        for _ in range(8):
            column = rng.uniform(100.0, 9900.0)
            row = rng.uniform(-1500.0, 1500.0) if scan else rng.uniform(100.0, 9900.0)
            y = case.line_offset_px if scan else row - 4999.5
            s = np.array([(column - 4999.5) * pitch / focal, y * pitch / focal, 1.0])
            t = t0 + (row * period if scan else 0.0)
            seen = camera_attitude(image, t0, t) @ (s / np.linalg.norm(s))
            lon, lat, h = ground_point(*orbit(t), seen, t, rng.uniform(0.0, 1000.0), case.aberration)
            name = f"m{len(tables['lm'])}"
            tables["lm"].append([name, np.degrees(lat), np.degrees(lon), h, 1.0])
            tables["obs"].append([f"i{image}", name, column + shift, row + shift, 0.2])
    folder.mkdir(parents=True, exist_ok=True)
    _table(folder / "eph.csv", "time,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s", tables["eph"])
    _table(folder / "att.csv", "time,qx,qy,qz,qw", tables["att"])
    _table(folder / "lm.csv", "landmark_id,latitude_deg,longitude_deg,height_m,sigma_m", tables["lm"])
    _table(folder / "img.csv", "image_id,time" + (",line_period_s" if scan else ""), tables["img"])
    _table(folder / "obs.csv", "image_id,landmark_id,column_px,row_px,sigma_px", tables["obs"])
    x, y, z, w = Rotation.from_matrix(model).as_quat()
    ends = ("GCRF", "st") if case.direction == "to tracker" else ("st", "J2000")
    point_row = case.line_offset_px if scan else 4999.5 + shift
    (folder / "campaign.toml").write_text(f"""
campaign = {{ name = "independent", time_scale = "{case.scale}" }}
images = {{ file = "img.csv" }}
landmarks = {{ file = "lm.csv" }}
observations = {{ file = "obs.csv" }}
ephemeris = {{ file = "eph.csv", frame = "ITRF", sigma_m = 3.0 }}
attitude = {{ file = "att.csv", from = "{ends[0]}", to = "{ends[1]}", sigma_arcsec = [5.0, 5.0, 12.0] }}
mounting = {{ from = "camera", to = "st", quaternion_wxyz = [{w}, {x}, {y}, {z}] }}
corrections = {{ aberration = {str(case.aberration).lower()} }}
[camera]
model = "{case.model}"
focal_length_mm = {focal * 1e3}
pixel_pitch_um = {pitch * 1e6}
image_size_px = [10000, 10000]
principal_point_px = [{4999.5 + shift}, {point_row}]
pixel_origin = "{case.origin}"
""")
    return C_EK
