"""Telemetry and measurements as a small mission keeps them, written as the CSV tables of a campaign.

The script stands for your own: it has arrays of times, quaternions, positions, markers and pixels, and writes
each as one table with its columns named. Nothing is converted: the attitude goes from the body to the inertial
frame, times are GPS time and pixels count from the corner, as the mission's software has them, and
`campaign.toml` says so.
"""

import csv
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from _scene import C_EK_TRUE, SIGMAS, flight

from starplumb.physics import so3
from starplumb.physics.earth import itrf_to_geodetic
from starplumb.physics.timescales import format_iso
from starplumb.physics.units import DEG
from starplumb.plan import scene
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors

AXES = ("east", "north", "up")


def table(name: str, columns: dict[str, object]) -> None:
    """One CSV file; numbers in full."""
    with Path(name).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    print(f"{name}: {', '.join(columns)}")


rng = np.random.default_rng(21)
truth = flight(images=5, markers=9)
flown = scene.measured(truth, Errors.draw(observe(truth), rng), C_EK_TRUE)

# what the mission has: times in GPS, quaternions scalar first from body to inertial, positions without velocities
time = format_iso(flown.attitude.t_ns, "GPS", digits=9)
w, x, y, z = (flown.attitude.q_EF * [-1.0, -1.0, -1.0, 1.0])[:, [3, 0, 1, 2]].T
r_J, _ = flown.ephemeris.at(flown.attitude.t_ns)
latitude, longitude, height = itrf_to_geodetic(flown.landmarks.r_J)
s, names = flown.sightings, flown.landmarks.ids

table("attitude.csv", {"time": time, "qx": x, "qy": y, "qz": z, "qw": w})
table("ephemeris.csv", {"time": time, "x_m": r_J[:, 0], "y_m": r_J[:, 1], "z_m": r_J[:, 2]})
table("images.csv", {"image_id": flown.images.ids, "time": format_iso(flown.images.t_ns, "GPS", digits=9)})
table(
    "landmarks.csv",
    {
        "landmark_id": names,
        "latitude_deg": latitude / DEG,
        "longitude_deg": longitude / DEG,
        "height_m": height,
        **{
            f"sigma_{axis}_m": [sigma] * len(names) for axis, sigma in zip(AXES, SIGMAS.landmark, strict=True)
        },
    },
)
table(
    "observations.csv",
    {
        "image_id": [flown.images.ids[i] for i in s.image],
        "landmark_id": [names[i] for i in s.landmark],
        "column_px": s.column_px + 0.5,
        "row_px": s.row_px + 0.5,
        "sigma_px": s.sigma_px,
        "role": np.where(np.arange(s.image.size) % 9 == 0, "check", "control"),
    },
)
print("true mounting, quaternion_xyzw:", np.round(so3.to_quaternion(C_EK_TRUE), 7).tolist())

figure, axis = plt.subplots(figsize=(5, 3.6), layout="constrained")
for i, name in enumerate(flown.images.ids):
    axis.plot(
        longitude[s.landmark[s.image == i]] / DEG, latitude[s.landmark[s.image == i]] / DEG, "o", label=name
    )
axis.set(xlabel="longitude, deg", ylabel="latitude, deg", title="surveyed markers")
axis.legend(frameon=False, fontsize=8)
figure.savefig("own-tables.svg")
