"""A small campaign written by hand: good input whose every part a test may then spoil."""

from __future__ import annotations

from pathlib import Path

CAMPAIGN = """\
[campaign]
name = "by hand"
time_scale = "UTC"

[camera]
model = "frame"
focal_length_mm = 2200.0
pixel_pitch_um = 9.0
image_size_px = [12000, 12000]
principal_point_px = [5999.5, 5999.5]

[mounting]
from = "camera"
to = "star_tracker"
quaternion_xyzw = [0.0, 0.0, 0.0, 1.0]

[ephemeris]
file = "ephemeris.csv"
frame = "ITRF"
sigma_m = 3.0

[attitude]
file = "attitude.csv"
from = "ITRF"
to = "star_tracker"
sigma_arcsec = [5.0, 5.0, 12.0]

[landmarks]
file = "landmarks.csv"

[images]
file = "images.csv"

[observations]
file = "observations.csv"
"""

# A camera 680 km above 0 N 0 E that flies north at 7500 m/s; the chord is near enough to an arc for reading.
EPHEMERIS = """\
time,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s
2020-01-01T00:00:00.000,7058137.0,0.0,-15000.0,0.0,0.0,7500.0
2020-01-01T00:00:01.000,7058137.0,0.0,-7500.0,0.0,0.0,7500.0
2020-01-01T00:00:02.000,7058137.0,0.0,0.0,0.0,0.0,7500.0
2020-01-01T00:00:03.000,7058137.0,0.0,7500.0,0.0,0.0,7500.0
2020-01-01T00:00:04.000,7058137.0,0.0,15000.0,0.0,0.0,7500.0
"""

# E: x east, y south, z down, so C_EJ has the rows (0 1 0), (0 0 -1), (-1 0 0), a turn of 120 deg about (1, 1, -1).
ATTITUDE = """\
time,qx,qy,qz,qw
2020-01-01T00:00:00.000,0.5,0.5,-0.5,0.5
2020-01-01T00:00:02.000,0.5,0.5,-0.5,0.5
2020-01-01T00:00:04.000,0.5,0.5,-0.5,0.5
"""

LANDMARKS = """\
landmark_id,latitude_deg,longitude_deg,height_m,sigma_m
L1,0.05,0.05,10.0,0.5
L2,-0.05,0.05,20.0,0.5
L3,0.0,-0.06,30.0,0.5
"""

IMAGES = """\
image_id,time
I1,2020-01-01T00:00:01.500
I2,2020-01-01T00:00:02.500
"""

# As the identity mounting would show the landmarks, moved by a few tenths of a pixel.
OBSERVATIONS = """\
image_id,landmark_id,column_px,row_px,sigma_px
I1,L1,8000.3,2658.1,0.2
I1,L2,8000.6,6632.7,0.2
I1,L3,3598.2,4645.3,0.2
I2,L1,8000.4,5353.8,0.2
I2,L2,8000.5,9329.2,0.2
"""

FILES = {
    "campaign.toml": CAMPAIGN,
    "ephemeris.csv": EPHEMERIS,
    "attitude.csv": ATTITUDE,
    "landmarks.csv": LANDMARKS,
    "images.csv": IMAGES,
    "observations.csv": OBSERVATIONS,
}


def write_good_campaign(folder: Path, **replaced: str) -> Path:
    """The files above in ``folder``, texts replaced by keywords without the ending; the path of campaign.toml."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in FILES.items():
        (folder / name).write_text(replaced.get(name.split(".")[0], text), encoding="utf-8")
    return folder / "campaign.toml"
