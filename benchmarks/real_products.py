"""What ground points say of the attitude of two real products, raw against filtered, and the samples of each.

    python benchmarks/real_products.py ../shared/data

Pleiades-1B has raw and filtered quaternions, 8 Hz; the vendor's location grid gives the ground points.  Its image is
cut into strips of rows, each an image with an attitude error of its own, so that their scatter tells of the attitude;
20 nodes of the grid each, with 0.1 m of survey noise, pixels exact to 0.05.  QuickBird-2 has quaternions at 50 Hz with
their covariance; its corners are the only ground points.  "Neighbours": each sample against what the four around it
predict, as a sigma of one sample, about the axes of the tracker.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from starplumb.estimators.gls import Gls
from starplumb.io.vendors.digitalglobe import read_digitalglobe
from starplumb.io.vendors.digitalglobe_geo import Optics
from starplumb.io.vendors.dimap import read_dimap
from starplumb.io.vendors.vendor import Corners
from starplumb.judge.calibrate import Calibration, calibrate
from starplumb.physics import so3
from starplumb.physics.earth import geodetic_to_itrf
from starplumb.physics.series import Attitude
from starplumb.physics.units import ARCSEC
from starplumb.table.campaign import Campaign, Landmarks, SharedErrors, Sightings

Array = np.ndarray
QUICKBIRD = Optics(principal_distance_mm=8836.202, pitch_mm=0.01191396, origin_mm=(9.54684, 164.02773))
STATED_ARCSEC = (0.3, 0.3, 0.3)
STRIPS, NODES, SURVEY_M, PIXEL = 20, 20, 0.1, 0.05


def grid(folder: Path) -> tuple[Array, Array]:
    """Pixels (n, 2) counted from 0 and ground points (n, 3) of the vendor's nodes."""
    import rasterio

    with rasterio.open(next(folder.glob("GRID*.tif"))) as file:
        bands, tags, place = file.read(), file.tags(), file.transform
    n = np.arange(bands.shape[1])
    row, column = np.meshgrid(place.f + 0.5 + n * place.e, place.c + 0.5 + n * place.a, indexing="ij")
    pixel = np.stack([column.ravel(), row.ravel()], axis=-1) - 1.0
    layers = range(0, len(bands), 2)
    ground = [
        geodetic_to_itrf(
            np.radians(bands[b + 1]).ravel(),
            np.radians(bands[b]).ravel(),
            np.full(len(pixel), float(tags[f"ALTITUDE_B{b}"])),
        )
        for b in layers
    ]
    return np.tile(pixel, (len(layers), 1)), np.concatenate(ground)


def cut(campaign: Campaign, pixel: Array, p_J: Array, rng: np.random.Generator) -> Campaign:
    """Strips of rows as images of their own, with nodes of the grid drawn in each."""
    rows = float(np.max(pixel[:, 1])) + 1.0
    strip = np.minimum((pixel[:, 1] * STRIPS / rows).astype(int), STRIPS - 1)
    chosen = np.concatenate(
        [rng.choice(np.flatnonzero(strip == i), NODES, replace=False) for i in range(STRIPS)]
    )
    first = np.arange(STRIPS) * rows / STRIPS
    period_s = float(campaign.images.line_period_s[0])
    images = replace(
        campaign.images,
        ids=tuple(f"strip{i + 1:02d}" for i in range(STRIPS)),
        t_ns=campaign.images.t_ns[0] + np.rint(1e9 * period_s * first).astype(np.int64),
        line_period_s=np.full(STRIPS, period_s),
    )
    noise = SURVEY_M * rng.standard_normal((chosen.size, 3))
    covariance = np.tile(SURVEY_M**2 * np.eye(3), (chosen.size, 1, 1))
    landmarks = Landmarks(tuple(map(str, range(chosen.size))), p_J[chosen] + noise, covariance)
    mark = pixel[chosen] - np.stack([np.zeros(chosen.size), first[strip[chosen]]], axis=-1)
    sightings = Sightings(
        strip[chosen],
        np.arange(chosen.size),
        mark[:, 0],
        mark[:, 1],
        np.full(chosen.size, PIXEL),
        np.zeros(chosen.size, dtype=bool),
    )
    own = SharedErrors("image")
    return replace(
        campaign,
        images=images,
        landmarks=landmarks,
        sightings=sightings,
        attitude_errors=own,
        position_errors=own,
    )


def neighbours(attitude: Attitude) -> Array:
    """Sigma (3,) rad of one sample about E, from what the two on either side predict: the fourth difference has the
    variance 70 times that of white noise."""
    C = so3.from_quaternion(attitude.q_EF)
    turn = so3.log(C[1:] @ C[:-1].mT)
    return np.asarray(np.sqrt(np.mean(np.diff(turn, n=3, axis=0) ** 2, axis=0) / 70.0))


def words(values: Sequence[float] | Array) -> str:
    return " ".join(f"{x:.3f}" if abs(x) < 0.1 else f"{x:.2f}" for x in values)


def line(name: str, done: Calibration, samples: Array) -> str:
    sources = [] if done.from_data is None else done.from_data.sources
    said = [
        f"{s.name.split(' and ')[0]}: {s.found:.2g} {s.unit}"
        + (
            ""
            if s.interval is None
            else f" ({s.interval[0] * s.stated:.2g} to {s.interval[1] * s.stated:.2g})"
        )
        for s in sources
    ]
    cells = [
        name,
        words(samples / ARCSEC),
        done.status.name.lower(),
        "; ".join(said)
        or f"{done.estimate.chi2:.1f} of chi-square, {done.estimate.degrees_of_freedom} degrees",
        words(done.sigma_E / ARCSEC),
        "" if done.from_data is None else words(done.from_data.sigma_E / ARCSEC),
    ]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("../shared/data")
    print(
        "| attitude | neighbours | status | the data say | sigma stated | from the data |\n|---|---|---|---|---|---|"
    )
    pixel, p_J = grid(folder / "pleiades1b")
    found = {}
    for choice in ("raw", "filtered"):
        product = read_dimap(next((folder / "pleiades1b").glob("PHRDIMAP*.XML")), choice)
        whole = product.campaign(0.1, STATED_ARCSEC)
        campaign = cut(whole, pixel, p_J, np.random.default_rng(1))
        found[choice] = calibrate(campaign, Gls())
        print(line(f"Pleiades-1B, {choice}", found[choice], neighbours(whole.one_attitude)), flush=True)
    apart = so3.log(found["raw"].estimate.C_EK @ found["filtered"].estimate.C_EK.mT) / ARCSEC
    product = read_digitalglobe(next((folder / "quickbird2").glob("*.IMD")), QUICKBIRD)
    print(line("QuickBird-2, four corners", *by_corners(product.campaign(), product.corners)))
    print(f"\nPleiades-1B, mounting by raw less by filtered samples: {words(apart)} arcsec")


def by_corners(campaign: Campaign, corners: Corners) -> tuple[Calibration, Array]:
    n = corners.column_px.size
    landmarks = Landmarks(tuple(map(str, range(n))), corners.r_J, np.tile(SURVEY_M**2 * np.eye(3), (n, 1, 1)))
    image, marks = np.zeros(n, dtype=np.int64), (corners.column_px, corners.row_px)
    sightings = Sightings(image, np.arange(n), *marks, np.full(n, PIXEL), np.zeros(n, dtype=bool))
    done = calibrate(replace(campaign, landmarks=landmarks, sightings=sightings), Gls())
    return done, neighbours(campaign.one_attitude)


if __name__ == "__main__":
    main()
