"""The example of ``starplumb init --imagery``: raw images of drawn ground, an orthoimage and heights, the true mounting
known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..ground.grid import Terrain
from ..imagery.drawn.ground import Ground, Look
from ..imagery.drawn.plane import Plane
from ..imagery.drawn.relief import ErrorField, relief
from ..imagery.drawn.render import Sensor, View, picture
from ..imagery.drawn.sheet import Sheet
from ..imagery.drawn.sky import Sky
from ..physics import so3
from ..physics.camera import Camera, FrameCamera, LineScanCamera
from ..physics.earth import geodetic_to_itrf, itrf_to_geodetic
from ..physics.light import Corrections
from ..physics.orientation import EarthOrientation
from ..physics.timescales import parse
from ..physics.units import ARCSEC, DEG
from ..table.campaign import Campaign
from ..table.geometry import observe
from ..table.simulate import Errors
from . import scene
from .demo import EPOCH, ORBIT

Array = NDArray[np.float64]

SIZE_PX = 480
FOCAL_M, PITCH_M = 0.44, 9e-6
PIXEL_M = 14.0
"""Size of a pixel on the ground straight below; the orthoimage has the same."""
TIMES_S = np.array([-22.0, -8.0, 7.0, 21.0])
SIGMA_MOUNTING = np.array([300.0, 300.0, 600.0]) * ARCSEC
SIGMAS = scene.Sigmas(
    attitude=np.array([3.0, 3.0, 12.0]) * ARCSEC,
    position=np.array([3.0, 3.0, 3.0]),
    landmark=np.array([0.5, 0.5, 3.0]),
    pixel=0.1,
)
"""``landmark`` is the error of the orthoimage and of the heights, shared over LENGTH_M."""
LENGTH_M = 1000.0
REACH_M = 5600.0
"""Half the side of the orthoimage."""
RIM_M = 300.0
"""How much farther ground is drawn: for splines, and for the errors of the orthoimage."""
EDGE_M = 20e3
"""Half the side of the ground that has heights: the lines of sight of tilted images are looked for there."""
POST_M, LOW_M, HILLS_M = 90.0, 150.0, 120.0
CLOUD = (0.1, 0.35, 0.2, 0.3)
THEN = Look(season=0.2, changed=0.06, seed=1)
"""What has become of the ground since the orthoimage was made."""
SPACING = 1.0
"""Coarse for the sake of time: the images then err by 0.002 px."""


@dataclass(frozen=True)
class DrawnDemo:
    """A campaign without sightings, its true mounting ``C_EK_true``, a raw image (r, c) for each of its images, and the
    reference: an ``ortho`` (r, c) of grey values whose north-western pixel lies at ``corner`` and whose pixels are
    ``step`` wide and high, degrees of longitude and latitude, and heights ``dem``."""

    campaign: Campaign
    C_EK_true: Array
    raws: tuple[NDArray[np.uint16], ...]
    ortho: NDArray[np.uint8]
    corner: tuple[float, float]
    step: tuple[float, float]
    dem: Terrain


def drawn_demo(seed: int = 1, line_period_s: float = 0.0) -> DrawnDemo:
    """Four images of one site from one pass, half of them turned by 90 deg, under cloud, with changed ground.

    With a line period they are those of a line scanner, half of them turned by 180 deg.
    """
    rng = np.random.default_rng(seed)
    truth, plane = flown(line_period_s)
    ground = Ground(seed, 0.6 * PIXEL_M)
    terrain = relief(seed, plane, (-EDGE_M, EDGE_M), (-EDGE_M, EDGE_M), POST_M, LOW_M, HILLS_M)
    now = Sheet.of(ground, REACH_M + RIM_M, THEN, SPACING)
    view = View(truth, truth.C_EK, terrain, plane, now, SPACING)
    raws = tuple(_raw(view, image, seed, rng) for image in range(TIMES_S.size))
    side = (-REACH_M, REACH_M)
    east, north, up = (ErrorField.draw(rng, s, LENGTH_M, side, side) for s in SIGMAS.landmark)
    x = np.arange(-REACH_M, REACH_M, PIXEL_M)
    C_EK_model = so3.exp(rng.normal(0.0, SIGMA_MOUNTING)) @ truth.C_EK
    measured = scene.measured(truth, Errors.draw(observe(truth), rng), C_EK_model)
    return DrawnDemo(
        replace(measured, sigma_mounting=SIGMA_MOUNTING),
        truth.C_EK,
        raws,
        _ortho(Sheet.of(ground, REACH_M + RIM_M, spacing=SPACING), x, east, north),
        *_corner(plane, x),
        _surveyed(terrain, plane, up),
    )


def _corner(plane: Plane, x: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """Longitude and latitude, deg, of the north-western pixel of the orthoimage, and the size of its pixels."""
    latitude, longitude = plane.geodetic(x[:2], x[:-3:-1])
    corner = float(longitude[0]) / DEG, float(latitude[0]) / DEG
    return corner, (float(np.ptp(longitude)) / DEG, float(np.ptp(latitude)) / DEG)


def _camera(scans: bool) -> Camera:
    middle = 0.5 * (SIZE_PX - 1.0)
    if scans:
        return LineScanCamera.from_optics(FOCAL_M, PITCH_M, (middle, 0.0), SIZE_PX, rows=SIZE_PX)
    return FrameCamera(FOCAL_M, PITCH_M, (middle, middle), (SIZE_PX, SIZE_PX))


def flown(line_period_s: float) -> tuple[Campaign, Plane]:
    """The true campaign, and the plane about the site that its images aim at."""
    orientation = EarthOrientation.load()
    epoch_ns = int(parse([EPOCH], "UTC")[0])
    below, v_J = scene.fly(ORBIT, orientation, epoch_ns, np.zeros(1))
    aside = np.cross(below, v_J)
    aside /= np.linalg.norm(aside)
    latitude, longitude, _ = itrf_to_geodetic(below + 50e3 * aside)
    plane = Plane(float(latitude[0]), float(longitude[0]))
    site = geodetic_to_itrf(plane.latitude, plane.longitude, LOW_M + 3.0 * HILLS_M)
    scans = line_period_s > 0.0
    turns: Array = (np.pi if scans else 0.5 * np.pi) * (np.arange(TIMES_S.size, dtype=np.float64) % 2)
    flight = scene.Pass(TIMES_S, np.tile(site, (TIMES_S.size, 1)), turns)
    C_EK = so3.exp(DEG * np.array([0.3, -0.8, 91.0]))
    flown = scene.photograph(
        _camera(scans),
        ORBIT,
        orientation,
        epoch_ns,
        flight,
        C_EK,
        SIGMAS,
        Corrections(),
        line_period_s,
        "drawn ground",
    )
    return flown, plane


def _raw(view: View, image: int, seed: int, rng: np.random.Generator) -> NDArray[np.uint16]:
    sensor = Sensor()
    sky = Sky(CLOUD[image], seed=100 * seed + image, size_px=128.0, shadow_px=(24.0, 18.0))
    seen = view.brightness(image, (SIZE_PX, SIZE_PX), sensor.psf_px, THEN, sky)
    return sensor.expose(seen, rng)


def _ortho(ground: Sheet, x: Array, east: ErrorField, north: ErrorField) -> NDArray[np.uint8]:
    """Grey values 1 to 255, the northernmost row first, of ground that seems to lie where it does not quite."""

    def places(column: Array, row: Array) -> tuple[Array, Array]:
        to_east, to_north = x[0] + PIXEL_M * column, x[-1] - PIXEL_M * row
        upwards = to_north[::-1]
        moved = [field.at(to_east, upwards)[::-1] for field in (east, north)]
        return to_east + moved[0], to_north[:, None] + moved[1]

    bright = picture(ground, places, (x.size, x.size), 0.4, spacing=SPACING)
    return np.asarray(np.clip(np.rint(110.0 + 36.0 * bright), 1, 255), dtype=np.uint8)


def _surveyed(terrain: Terrain, plane: Plane, up: ErrorField) -> Terrain:
    """The heights below the orthoimage, with the error of their survey."""
    rows, columns = (np.arange(count, dtype=np.float64) for count in terrain.height.shape)
    latitude = terrain.latitude + terrain.step[0] * rows
    longitude = terrain.longitude + terrain.step[1] * columns
    x, y = plane.metres(latitude, longitude)
    chosen = [np.abs(values) <= REACH_M for values in (x, y)]
    error = up.at(x[chosen[0]], y[chosen[1]][::-1])[::-1]
    height = terrain.height[np.ix_(chosen[1], chosen[0])] + error
    return Terrain(height, float(latitude[chosen[1]][0]), float(longitude[chosen[0]][0]), terrain.step)
