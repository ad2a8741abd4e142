"""starplumb: in-flight alignment of an Earth-observation camera with its star tracker.

The constitution. Everything below holds in every module and is written down nowhere else.

Frames, one capital letter each, all right-handed and orthonormal:

====  =============================================================================================
J     Earth-fixed (ITRF); positions live here and are never turned into another frame
I     inertial (GCRF)
E     star tracker: the frame in which the attitude is given
K     camera: x right (growing column), y down (growing row), z along the boresight to the scene
O     orbital: x along track, y opposite to the orbit normal, z down
T     local level: x east, y north, z up
====  =============================================================================================

Names. ``C_BA`` takes coordinates from A to B (read "B from A"): ``v_B = C_BA @ v_A``; touching letters cancel,
``C_JK = C_JE @ C_EK``; the inverse is ``C_EK.mT``. A vector ends in its frame: ``r_J``, ``e_K``, ``theta_E``.
``_model`` marks the value known before, ``_true`` the truth of a simulation, no suffix the present estimate.

Signs. ``C_EK_model = exp(theta_E) @ C_EK_true``; a correction is applied as ``C_EK_new = exp(d_E) @ C_EK_model``.
A measured attitude or position is the true one plus its error: ``C_EJ = exp(alpha_E) @ C_EJ_true``,
``r_J = r_J_true + rho_J``. ``exp`` and ``log`` are exact everywhere; small angles appear in Jacobians only.

Units. SI and radians in every function; any other unit stands in the name (``sigma_arcsec``, ``column_px``) and only
at the edge. Epochs are ``t_ns``: int64 nanoseconds of TAI since 2000-01-01T12:00:00 TAI, so that differences are exact.

Shapes. Leading axes are the batch, trailing axes the object; ``()`` is one run.
"""

from __future__ import annotations

__version__ = "0.2.0"

_DOOR = {
    "AlignmentFailed": "physics.errors",
    "Archive": "session.mission.archive",
    "Budget": "session.budget",
    "Campaign": "session.campaign",
    "Check": "session.check",
    "Comparison": "session.comparison",
    "Diagnosis": "session.diagnosis",
    "InputError": "physics.errors",
    "Measurement": "session.imagery.measurement",
    "Projection": "session.ground.projection",
    "Plan": "session.planning.plan",
    "Prediction": "session.motion.prediction",
    "Result": "session.result",
    "Scenario": "session.scenario",
    "Study": "session.study",
    "budget": "session.budget",
    "calibrate": "session.calibration",
    "check": "session.check",
    "compare": "session.comparison",
    "demo": "session.campaign",
    "diagnose": "session.diagnosis",
    "locate": "session.ground.location",
    "measure": "session.imagery.measuring",
    "open_archive": "session.mission.archive",
    "plan_images": "session.planning.plan",
    "project": "session.ground.projection",
    "predict": "session.motion.prediction",
    "read_campaign": "session.campaign",
    "scenario": "session.scenario",
    "simulate": "session.study",
}
"""What a user imports and the module that has it, loaded when it is first asked for; ``__init__.pyi`` has the types."""


def __getattr__(name: str) -> object:
    if name not in _DOOR:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    found = getattr(import_module(f".{_DOOR[name]}", __name__), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_DOOR})
