"""Raw images of targets: their light integrated over pixels with SciPy's quadrature, and a camera's noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from PIL import Image
from scipy.special import erf

from starplumb.io.campaign.write import write_campaign
from starplumb.physics import so3
from starplumb.physics.camera import FrameCamera
from starplumb.physics.earth import itrf_to_geodetic
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan.demo import demo
from starplumb.table.geometry import locate, project

READ, GAIN, DARK = 4.0, 0.1, 200.0
SURVEY_M = 0.3


def light(size, at, width):
    """Light (size, size) of a point at (x, y) under a Gaussian, by the error function."""

    def along(c):
        edge = (np.arange(size + 1) - 0.5 - c) / (width * np.sqrt(2.0))
        return 0.5 * np.diff(erf(edge))

    return along(at[1])[:, None] * along(at[0])


def exposed(rng, seen):
    """Whole numbers of what is seen (DN) with read noise and photon noise."""
    return np.rint(seen + rng.normal(size=seen.shape) * np.sqrt(READ**2 + GAIN * seen))


def photographed(rng, size, pixels, strength, width=0.6):
    """An image of lights at pixels (n, 2)."""
    seen = np.full((size[1], size[0]), DARK)
    for at, total in zip(pixels, np.broadcast_to(strength, len(pixels)), strict=True):
        first = np.rint(at).astype(int) - 8
        i, j = (slice(max(f, 0), min(f + 17, n)) for f, n in zip(first[::-1], seen.shape, strict=True))
        own = total * light(17, at - first, width)
        seen[i, j] += own[i.start - first[1] : i.stop - first[1], j.start - first[0] : j.stop - first[0]]
    return exposed(rng, seen)


SECTIONS = """
[images]
file = "images.csv"
[imagery]
files = "{image_id}.png"
saturation_dn = 65535
[reference]
kind = "points"
files = ["lights.csv"]
sigma_m = 0.3
[measure]
check_share = 0.1
"""


def write_lights(folder, rng, apart_px, prior_px=10.0, images=3, size=400):
    """A campaign of lights on a lattice so many pixels apart, the mounting off by a draw of its prior; the true one."""
    campaign, C_EK_true = demo("frame", images, 3)
    middle = 0.5 * (size - 1.0)
    pixel = 9e-6 / 2.2
    camera = FrameCamera(2.2, 9e-6, (middle, middle), (size, size))
    prior = prior_px * pixel
    attitude = np.diag(np.full(3, (2.0 * ARCSEC) ** 2))
    C_EK_model = so3.exp(rng.normal(0.0, prior, 3)) @ C_EK_true
    campaign = replace(
        campaign,
        camera=camera,
        C_EK=C_EK_model,
        sigma_mounting=np.full(3, prior),
        cov_attitude_E=attitude,
        sigma_position=np.full(3, 0.5),
    )
    ids, r_J = [], []
    for image in range(images):
        lattice = np.arange(0.4 * apart_px, size, apart_px)
        at = np.stack(np.meshgrid(lattice, lattice), axis=-1).reshape(-1, 2) + rng.uniform(-9.0, 9.0, (1, 2))
        at += rng.uniform(-0.25, 0.25, at.shape) * apart_px
        place = locate(campaign, C_EK_true, np.full(len(at), image), *at.T, 30.0)
        ids += [f"L{image}-{k}" for k in range(len(at))]
        r_J.append(place)
    r_J = np.concatenate(r_J)
    write_campaign(folder, campaign)
    for image, name in enumerate(campaign.images.ids):
        own = so3.exp(rng.normal(0.0, 2.0 * ARCSEC, 3))
        at = project(campaign, own @ C_EK_true, np.full(len(r_J), image), r_J)
        at = at[np.all((at > -5.0) & (at < size + 4.0), axis=-1)]
        seen = photographed(rng, (size, size), at, rng.uniform(400.0, 6000.0, len(at)))
        Image.fromarray(seen.astype(np.uint16)).save(folder / f"{name}.png")
    latitude, longitude, height = itrf_to_geodetic(r_J + rng.normal(0.0, SURVEY_M, r_J.shape))
    rows = zip(ids, *(v.tolist() for v in (latitude / DEG, longitude / DEG, height)), strict=True)
    head = "landmark_id,latitude_deg,longitude_deg,height_m\n"
    (folder / "lights.csv").write_text(head + "".join(f"{i},{a!r},{b!r},{c!r}\n" for i, a, b, c in rows))
    text = (folder / "campaign.toml").read_text().split("[landmarks]")[0]
    (folder / "campaign.toml").write_text(text + SECTIONS)
    for name in ("landmarks.csv", "observations.csv"):
        (folder / name).unlink()
    return C_EK_true
