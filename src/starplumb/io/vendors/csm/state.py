"""Model states of the USGS sensor models for line scanners and frames, as the Ames Stereo Pipeline writes them.

Positions and quaternions (of the turn from the camera's axes to Earth-fixed ones, scalar last) are at even steps.
"""

from __future__ import annotations

import numpy as np

from ....physics.errors import InputError
from ...text.files import show
from ...text.json_node import JsonNode
from .model import Array, CsmModel, require_earth, require_whole
from .optics import RADIAL, RADTAN, TRANSVERSE, CsmOptics

LINE_SCANNER, FRAME = "USGS_ASTRO_LINE_SCANNER_SENSOR_MODEL", "USGS_ASTRO_FRAME_SENSOR_MODEL"
_KINDS = {0: RADIAL, 1: TRANSVERSE, 7: RADTAN}


def read_state(state: JsonNode, name: str) -> CsmModel:
    """The model that a state describes; ``name`` is that of the sensor model."""
    require_earth(state.path, state.number("m_majorAxis"), state.number("m_minorAxis"))
    return _line_scanner(state) if name == LINE_SCANNER else _frame(state)


def _line_scanner(state: JsonNode) -> CsmModel:
    _require_unadjusted(state)
    center = state.number("m_centerEphemerisTime", 0.0)
    positions = state.numbers("m_positions", -1, 3)
    quaternions = state.numbers("m_quaternions", -1, 4)
    begins = state.numbers("m_intTimeLines", -1)
    times = (state.numbers(key, begins.size) for key in ("m_intTimeStartTimes", "m_intTimes"))
    lines = np.stack([begins, *times], axis=-1)
    # a line of the table begins at the time beside it and is exposed half its duration later
    lines[:, 1] += center + 0.5 * lines[:, 2]
    return CsmModel(
        path=state.path,
        name=state.path.stem,
        size=(state.count("m_nSamples"), state.count("m_nLines")),
        optics=CsmOptics(
            focal_length=state.number("m_focalLength"),
            lines=state.numbers("m_iTransL", 3),
            samples=state.numbers("m_iTransS", 3),
            origin=(state.number("m_detectorLineOrigin"), state.number("m_detectorSampleOrigin")),
            start=(state.number("m_startingDetectorLine", 0.0), state.number("m_startingDetectorSample")),
            summing=(state.number("m_detectorLineSumming", 1.0), state.number("m_detectorSampleSumming")),
            kind=_kind(state),
            coefficients=_coefficients(state),
            z_direction=state.number("m_zDirection", 1.0),
        ),
        frame="ITRF",
        orbit_s=center + _even(state, "m_t0Ephem", "m_dtEphem", len(positions)),
        r_F=positions,
        v_F=state.numbers("m_velocities", len(positions), 3),
        attitude_s=center + _even(state, "m_t0Quat", "m_dtQuat", len(quaternions)),
        q_FC=_unit(state, "m_quaternions", quaternions),
        time_s=float(lines[0, 1]),
        lines=lines,
        dated=center != 0.0,
    )


def _frame(state: JsonNode) -> CsmModel:
    values = state.numbers("m_currentParameterValue", 7)
    time_s = state.number("m_ephemerisTime", 0.0)
    velocity = state.numbers("m_spacecraftVelocity", 1, 3)
    # the model takes the principal point off in the focal plane, in mm
    samples, lines = state.numbers("m_iTransS", 3), state.numbers("m_iTransL", 3)
    keys = ("m_startingDetectorLine", "m_startingDetectorSample")
    sums = ("m_detectorLineSumming", "m_detectorSampleSumming")
    start, summing = [state.number(key, 0.0) for key in keys], [state.number(key, 1.0) for key in sums]
    require_whole(state.path, (start[0], start[1]), (summing[0], summing[1]))
    for key in ("m_sample_pp", "m_line_pp"):
        if state.number(key, 0.0):
            raise state.error(
                key, state.value[key], "0: the centre of the detector states the principal point"
            )
    return CsmModel(
        path=state.path,
        name=state.path.stem,
        size=(state.count("m_nSamples"), state.count("m_nLines")),
        optics=CsmOptics(
            focal_length=state.number("m_focalLength"),
            lines=lines,
            samples=samples,
            origin=(float(state.numbers("m_ccdCenter", 2)[0]), float(state.numbers("m_ccdCenter", 2)[1])),
            kind=_kind(state),
            coefficients=_coefficients(state),
        ),
        frame="ITRF",
        orbit_s=np.array([time_s]),
        r_F=values[None, :3],
        v_F=velocity if np.any(velocity) else None,
        attitude_s=np.array([time_s]),
        q_FC=_unit(state, "m_currentParameterValue", values[None, 3:]),
        time_s=time_s,
        lines=None,
        dated=time_s != 0.0,
    )


def _even(state: JsonNode, start: str, step: str, n: int) -> Array:
    dt = state.number(step)
    if not dt > 0.0:
        raise state.error(step, dt, "a positive number of seconds")
    return np.asarray(state.number(start) + dt * np.arange(n))


def _kind(state: JsonNode) -> str:
    number = state.number("m_distortionType", 0)
    if int(number) not in _KINDS:
        raise state.error(
            "m_distortionType", state.value["m_distortionType"], "0 (radial) or 7 (radial-tangential)"
        )
    return _KINDS[int(number)]


def _coefficients(state: JsonNode) -> Array:
    """Coefficients that this reader knows how to apply. Raises InputError for others that are not zero."""
    found = state.numbers("m_opticalDistCoeffs", -1)
    if _kind(state) == TRANSVERSE:
        # x and y are polynomials of 10 terms, and 1, x and y alone are no distortion
        plain = np.zeros(20)
        plain[[1, 12]] = 1.0
        if found.size != 20 or not np.allclose(found, plain, rtol=0.0, atol=1e-15):
            raise state.error("m_opticalDistCoeffs", found.tolist(), "a transverse distortion of none")
        return np.empty(0)
    if _kind(state) == RADTAN and found.size != 5:
        raise state.error("m_opticalDistCoeffs", found.tolist(), "k1, k2, p1, p2, k3")
    return found


def _unit(node: JsonNode, key: str, q: Array) -> Array:
    norm = np.linalg.norm(q, axis=1)
    if not np.all(np.abs(norm - 1.0) < 1e-3):
        raise node.error(key, float(norm[np.argmax(np.abs(norm - 1.0))]), "quaternions of norm 1")
    return np.asarray(q / norm[:, None])


def _require_unadjusted(state: JsonNode) -> None:
    """Adjustable parameters other than zero move and turn the camera; nobody writes them but other adjusters."""
    if state.has("m_currentParameterValue") and np.any(
        values := state.numbers("m_currentParameterValue", -1)
    ):
        found = show(values.tolist())
        raise InputError(
            f"{state.path}, m_currentParameterValue: found {found}, wanted zeros: an unadjusted model"
        )
