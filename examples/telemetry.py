"""A small satellite's files as they come down, none of them in the form that starplumb would have written.

The script stands for your downlink and your ground software: an attitude log in Unix seconds with the scalar of the
quaternion first and a column that says when it is good, the GPS receiver's inertial states in kilometres, the ground
points that somebody clicked in QGIS, one file an image, and the surveyed places. The images are binned 2 x 2 and cut
out of the sensor; their times stand in their names. `campaign.toml` declares all that, and nothing is converted.
"""

from dataclasses import replace
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from _scene import C_EK_TRUE, EARTH, flight

from starplumb.physics import so3
from starplumb.physics.earth import itrf_to_geodetic
from starplumb.physics.light import inertial_velocity
from starplumb.physics.timescales import format_iso
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import scene
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors

STR_XYZW = np.array([0.2295752968, 0.8567866720, 0.1195093352, 0.4460149108])
SIGMA_STR = np.array([6.0, 6.0, 40.0]) * ARCSEC
CRS = "#CRS: EPSG:4326\n"


def unix(t_ns):
    """Unix seconds of epochs."""
    return [datetime.fromisoformat(f"{text}+00:00").timestamp() for text in format_iso(t_ns, "UTC", 6)]


def table(name, header, *columns):
    """One CSV file from columns of text."""
    lines = [",".join(row) for row in zip(*columns, strict=True)]
    Path(name).write_text("\n".join([header, *lines]) + "\n")
    print(f"{name}: {header}")


def digits(values, decimals):
    return [f"{value:.{decimals}f}" for value in values]


# the star tracker's errors are about its own axes, and it looks askew from the body
C_SB = so3.from_quaternion(STR_XYZW)
truth = flight(images=6, markers=10)
truth = replace(truth, cov_attitude_E=C_SB.T @ np.diag(SIGMA_STR**2) @ C_SB)
flown = scene.measured(truth, Errors.draw(observe(truth), np.random.default_rng(21)), C_EK_TRUE)

# attitude from the body to J2000, and between the images a mode in which it is not to be used
q = (flown.attitude.q_EF * [-1.0, -1.0, -1.0, 1.0])[:, [3, 0, 1, 2]]
rows = [(t, *digits(row, 9), "FINE") for t, row in zip(unix(flown.attitude.t_ns), q, strict=True)]
for a, b in pairwise(tuple(rows)):
    if b[0] - a[0] > 5.0:
        rows.append((a[0] + 2.0, "0.000000000", "0.000000000", "0.000000000", "0.000000000", "SLEW"))
time, *columns = zip(*sorted(rows), strict=True)
table("adcs_tlm.csv", "unix_time,q_s,q_x,q_y,q_z,mode", digits(time, 3), *columns)

t_ns = flown.ephemeris.t_ns
C_IJ = EARTH.C_IJ(t_ns)
r_I = np.einsum("nij,nj->ni", C_IJ, flown.ephemeris.r_J) / 1e3
v_I = np.einsum("nij,nj->ni", C_IJ, inertial_velocity(flown.ephemeris.r_J, flown.ephemeris.v_J)) / 1e3
states = (*(digits(column, 6) for column in r_I.T), *(digits(column, 9) for column in v_I.T))
table("gps_eci.csv", "unix_time,X_km,Y_km,Z_km,VX_kmps,VY_kmps,VZ_kmps", digits(unix(t_ns), 3), *states)

# QGIS counts columns from the left edge and rows from the upper edge downwards as negative numbers
latitude, longitude, height = itrf_to_geodetic(flown.landmarks.r_J)
latitude, longitude = latitude / DEG, longitude / DEG
s, surveyed = flown.sightings, []
for i, at in enumerate(flown.images.t_ns):
    stamp = datetime.fromisoformat(format_iso(at, "UTC", 6)[0])
    name = f"SAT1_{stamp:%Y%m%dT%H%M%S}.{stamp.microsecond // 1000:03d}Z_L1A"
    lines = ["mapX,mapY,sourceX,sourceY,enable,dX,dY,residual"]
    for row in np.flatnonzero(s.image == i):
        k = s.landmark[row]
        surveyed.append((f"{name}-{len(lines) + 2}", latitude[k], longitude[k], height[k]))
        column, line = s.column_px[row] + 0.5, s.row_px[row] + 0.5
        lines.append(f"{longitude[k]:.9f},{latitude[k]:.9f},{column:.3f},{-line:.3f},1,0,0,0")
    Path(f"{name}.points").write_text(CRS + "\n".join(lines) + "\n")
print(f"{name}.points and {len(flown.images.ids) - 1} more")

names, latitude, longitude, height = zip(*surveyed, strict=True)
places = (digits(latitude, 9), digits(longitude, 9), digits(height, 3))
sigmas = ([f"{sigma}"] * len(names) for sigma in (0.5, 0.5, 1.0))
header = "landmark_id,latitude_deg,longitude_deg,height_m,sigma_east_m,sigma_north_m,sigma_up_m"
table("landmarks.csv", header, names, *places, *sigmas)
print("true mounting, rotation vector, deg:", np.round(so3.log(C_EK_TRUE) / DEG, 4).tolist())

figure, axis = plt.subplots(figsize=(5, 3.6), layout="constrained")
axis.plot(longitude, latitude, "o")
axis.set(xlabel="longitude, deg", ylabel="latitude, deg", title="surveyed places")
figure.savefig("telemetry.svg")
