"""The error sources of a scenario: star trackers and sections [truth.NAME], brought inside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ...physics.units import ARCSEC, DEG
from ...plan import error_catalogue as errors
from ...plan.error_catalogue import Flight, Tracker
from ...table.error_sources import Distribution, Source
from .config import ScenarioConfig
from .error_config import SHARED_BY, ErrorConfig, TrackerConfig

Array = NDArray[np.float64]


def _tracker(config: TrackerConfig) -> Tracker:
    if config.quaternion_xyzw is not None:
        C = so3.from_quaternion(config.quaternion_xyzw)
    elif config.rotation_vector_deg is not None:
        C = so3.exp(DEG * np.array(config.rotation_vector_deg))
    else:
        C = _turn_onto(np.array(config.boresight or (0.0, 0.0, 1.0)))
    return Tracker(config.name, C, ARCSEC * np.array(config.sigma_arcsec))


def _turn_onto(direction: Array) -> Array:
    """The smallest rotation that takes the z axis to a direction (3,)."""
    across = np.array([-direction[1], direction[0], 0.0])
    sine = np.linalg.norm(across)
    axis = across / sine if sine > 0.0 else np.array([1.0, 0.0, 0.0])
    return so3.exp(np.arctan2(sine, direction[2]) * axis)


def error_sources(config: ScenarioConfig, flight: Flight) -> tuple[Source, ...]:
    """The sources of a document: the noise of its trackers, then its sections [truth.NAME]."""
    trackers = tuple(_tracker(tracker) for tracker in config.trackers)
    axes = dict(
        zip((t.name for t in trackers), errors.fused_axes(trackers, config.scenario.fusion), strict=True)
    )
    noise = [errors.attitude(flight, t.name, t.sigma, axes[t.name], "image") for t in trackers]
    return (*noise, *(_source(flight, name, error, axes) for name, error in config.truth.items()))


def _source(flight: Flight, name: str, error: ErrorConfig, tracker_axes: dict[str, Array]) -> Source:
    """One section [truth.NAME]."""
    shape = Distribution(error.distribution, error.degrees_of_freedom)
    shared_by = error.shared_by or SHARED_BY.get(error.error, ("",))[0]
    axes = tracker_axes[error.tracker] if error.tracker is not None else np.eye(3)
    arcsec, metres = ARCSEC * np.array(error.sigma_arcsec or 0.0), np.array(error.sigma_m or 0.0)
    px = error.sigma_px or 0.0
    match error.error:
        case "attitude" if error.correlation_time_s is not None:
            return errors.correlated_attitude(flight, name, arcsec, axes, error.correlation_time_s, shape)
        case "wander":
            return errors.wander(flight, name, arcsec, axes, error.correlation_time_s or 1.0, shape)
        case "attitude":
            return errors.attitude(flight, name, arcsec, axes, shared_by, shape)
        case "drift":
            return errors.drift(flight, name, arcsec, axes, error.harmonics, shape)
        case "position" if error.correlation_time_s is not None:
            return errors.correlated_position(
                flight, name, metres, error.frame, error.correlation_time_s, shape
            )
        case "position":
            return errors.position(flight, name, metres, error.frame, shared_by, shape)
        case "landmark" if error.correlation_length_m is not None:
            return errors.correlated_landmark(flight, name, metres, error.correlation_length_m, shape)
        case "look-angles":
            return errors.look_angles(flight, name, px, shape)
        case "refraction":
            return errors.refraction(flight, name, 0.01 * (error.sigma_percent or 0.0), shape)
        case "landmark":
            return errors.landmark(flight, name, metres, shared_by, shape)
        case "pixel" if error.sigma_column_px is not None:
            own = (error.sigma_column_px, error.sigma_row_px or 0.0, error.correlation or 0.0)
            return errors.elongated_pixel(flight, name, *own, shape)
        case "pixel":
            return errors.pixel(flight, name, px, shape)
        case "rounding":
            return errors.rounding(flight, name, error.step_px or 0.0)
        case "blunder":
            return errors.pixel(
                flight, name, error.size_px or 0.0, Distribution("blunder", rate=error.rate or 0.0)
            )
        case "time-tag":
            return errors.time_tag(flight, name, 1e-3 * (error.sigma_ms or 0.0), shared_by, shape)
        case "focal-length":
            return errors.focal_length(flight, name, 1e-6 * (error.sigma_ppm or 0.0), shape)
        case _:
            return errors.principal_point(flight, name, px, _radians_per_pixel(flight), shape)


def _radians_per_pixel(flight: Flight) -> Array:
    """Of the camera of each sighting (n,)."""
    width = np.linalg.norm(flight.truth.slope_K[..., 0], axis=-1)
    found = np.zeros(width.size)
    for camera in np.unique(flight.camera):
        found[flight.camera == camera] = np.median(width[flight.camera == camera])
    return found
