"""The usual mistakes in reading images, cameras and landmarks, each as the change that would undo it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...physics.camera import Camera, FrameCamera, LineScanCamera
from ...physics.earth import WGS84_F, geodetic_to_itrf, itrf_to_geodetic
from ...physics.errors import InputError
from ...table.campaign import Campaign
from .mistake import Mistake

Array = NDArray[np.float64]
Places = tuple[Array, Array, Array]
"""Geodetic latitude and longitude (rad) and height (m)."""

FOOT_M = 0.3048
BINNINGS = (2, 3, 4, 8)
SCALES = (10.0, 25.4, 100.0, 1000.0)
"""Ratios of units that a focal length or a pixel pitch is written in: powers of ten, inches and millimetres."""


def misread_image_and_ground(campaign: Campaign) -> list[Mistake]:
    """The mistakes of this module worth trying on a campaign, the simplest first."""
    return [*_pixels(), *_binning(), *_camera_units(), *_landmarks()]


def _pixels() -> Iterator[Mistake]:
    """Columns and rows swapped, counted from the other side or from another origin."""

    def swapped(c: Campaign) -> Campaign:
        s = c.sightings
        ellipse = None if s.ellipse is None else s.ellipse[:, ::-1, ::-1]
        return replace(c, sightings=replace(s, column_px=s.row_px, row_px=s.column_px, ellipse=ellipse))

    yield Mistake(
        "pixels.swapped",
        "columns and rows of the observations are swapped",
        "exchange column_px and row_px",
        swapped,
    )
    for axis, side, field in ((0, "right", "column_px"), (1, "bottom", "row_px")):

        def mirrored(c: Campaign, axis: int = axis, field: str = field) -> Campaign:
            count = c.camera.size_px[axis]
            if not np.isfinite(count):
                raise InputError("the image has no stated end to count from")
            s, pixel = c.sightings, count - 1.0 - getattr(c.sightings, field)
            ellipse = None if s.ellipse is None else s.ellipse * np.array([[1.0, -1.0], [-1.0, 1.0]])
            return replace(c, sightings=replace(s, ellipse=ellipse, **{field: pixel}))

        yield Mistake(
            f"pixels.{field}_from_{side}",
            f"{field} is counted from the {side} of the image",
            f"count {field} from the other side",
            mirrored,
        )
    origins = (
        (0.5, "0.5 px too small"),
        (-0.5, "0.5 px too large (a corner as origin)"),
        (-1.0, "1 px too large"),
    )
    for shift, words in origins:

        def shifted(c: Campaign, shift: float = shift) -> Campaign:
            s = c.sightings
            return replace(c, sightings=replace(s, column_px=s.column_px + shift, row_px=s.row_px + shift))

        yield Mistake(
            f"pixels.origin{shift:+g}",
            f"the observations' pixels are {words} against the camera's principal point",
            "check camera.pixel_origin, and whether pixels are counted from 0 or from 1",
            shifted,
        )


def _binning() -> Iterator[Mistake]:
    """Pixels counted in a binned image though the camera's pitch is that of a single pixel, or the other way round."""
    for n in BINNINGS:
        for factor, words, side in (
            (float(n), f"pixels of {n} x {n} binned ones", "binned"),
            (1.0 / n, f"single pixels, of which {n} x {n} make one of the camera's", "single"),
        ):

            def undo(c: Campaign, factor: float = factor) -> Campaign:
                s = c.sightings
                column, row = (factor * (pixel + 0.5) - 0.5 for pixel in (s.column_px, s.row_px))
                sightings = replace(s, column_px=column, row_px=row, sigma_px=factor * s.sigma_px)
                return replace(c, sightings=sightings)

            yield Mistake(
                f"binning.{side}{n}",
                f"the observations count {words}",
                "give camera.pixel_pitch_um, image_size_px and principal_point_px of the pixels that are counted",
                undo,
            )


def _camera_units() -> Iterator[Mistake]:
    """A focal length or a pixel pitch in another unit than its name says."""
    for ratio in SCALES:
        for scale, words in ((ratio, "large"), (1.0 / ratio, "small")):

            def undo(c: Campaign, scale: float = scale) -> Campaign:
                return replace(c, camera=magnified(c.camera, scale))

            yield Mistake(
                f"camera.unit.{scale:g}",
                f"the focal length is {ratio:g} times too {'small' if words == 'large' else 'large'} against the pixel "
                "pitch: one of them is in another unit",
                "give camera.focal_length_mm in mm and camera.pixel_pitch_um in um (look angles as tangents)",
                undo,
            )


def magnified(camera: Camera, scale: float) -> Camera:
    """The camera with a focal length ``scale`` times as long for the same pixels."""
    if isinstance(camera, FrameCamera):
        return replace(camera, focal_length=scale * camera.focal_length)
    if isinstance(camera, LineScanCamera):
        return replace(camera, tan_x=camera.tan_x / scale, tan_y=camera.tan_y / scale)
    raise InputError("the camera has no focal length")


def _landmarks() -> Iterator[Mistake]:
    """Geodetic coordinates exchanged, mirrored, geocentric or in feet."""
    remedy = "correct the table of landmarks"
    kinds: tuple[tuple[str, str, str, Callable[[Places], Places]], ...] = (
        ("exchanged", "latitude and longitude of the landmarks are exchanged", remedy, _exchanged),
        (
            "longitude_sign",
            "the longitudes of the landmarks have the wrong sign (west counted as positive)",
            f"{remedy}: longitude_deg grows towards the east",
            lambda p: (p[0], -p[1], p[2]),
        ),
        (
            "latitude_sign",
            "the latitudes of the landmarks have the wrong sign",
            f"{remedy}: latitude_deg is positive in the north",
            lambda p: (-p[0], p[1], p[2]),
        ),
        (
            "geocentric",
            "the latitudes of the landmarks are geocentric, not geodetic",
            f"{remedy}: latitude_deg is geodetic, or give x_m, y_m, z_m",
            lambda p: (np.arctan(np.tan(p[0]) / (1.0 - WGS84_F) ** 2), p[1], p[2]),
        ),
        (
            "feet",
            "the heights of the landmarks are in feet, not in metres",
            f"{remedy}: height_m is in metres",
            lambda p: (p[0], p[1], FOOT_M * p[2]),
        ),
    )
    for key, what, advice, change in kinds:
        yield Mistake(f"landmarks.{key}", what, advice, _moving(change))


def _exchanged(places: Places) -> Places:
    """Raises InputError where a longitude cannot be a latitude."""
    latitude, longitude, height = places
    if np.any(np.abs(longitude) > np.pi / 2):
        raise InputError("a longitude of a landmark is beyond 90 deg and cannot be a latitude")
    return longitude, latitude, height


def _moving(change: Callable[[Places], Places]) -> Callable[[Campaign], Campaign]:
    """The change of a campaign whose landmarks have other places, their sigmas the same east, north and up."""

    def undo(c: Campaign) -> Campaign:
        new = change(itrf_to_geodetic(c.landmarks.r_J))
        return replace(c, landmarks=c.landmarks.moved(geodetic_to_itrf(*new)))

    return undo
