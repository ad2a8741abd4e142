"""Draws, scene and observer of Tkachenko 2019 in one pass over component rows: the fast way to many runs.

The runs are those of :mod:`starplumb.published.tkachenko_scene`, which goes through the one simulator; this pass is
half as fast again (docs/design/simulators.md), and a test holds the two against each other.
Written like :mod:`starplumb.estimators.published.observer_rows`, whose work rows it fills.  Draws (rows of ``Z``):
initial error 3, relative focal error 1, then per image: aim 2, attitude 3, position 3, and per marker of it column
and row 2."""

from __future__ import annotations

import numpy as np

from ..estimators.published.observer import Observer
from ..estimators.published.observer_rows import (
    AXES,
    E_E,
    FLOOR,
    SIGHTING_ROWS,
    STATE,
    STATE_ROWS,
    Parameters,
    Update,
    form,
    one_cycle,
)
from ..physics import so3
from ..physics.components import (
    WIDTH,
    Array,
    Quaternion,
    Row,
    Triple,
    axes,
    conjugate,
    four,
    multiply,
    put_four,
    put_six,
    put_three,
    root,
    rotate,
    three,
    turn,
    unit,
)
from ..physics.errors import InputError
from .tkachenko_scene import C_EK_MODEL, Scene

RUN_DRAWS = 4
IMAGE_DRAWS = 8
MARKER_DRAWS = 2
FOCAL, CAMERA, TRACKER, POSITION, TRUTH_ROWS = 4, 5, 9, 13, 16
"""Rows of K, what is true of a run and of its present image, behind C_EK: focal length, C_KJ, measured C_EJ, error of
position; and how many they are."""


def begin(D: Array, K: Array, q_model: Array, sigma: Array) -> None:
    """Rows 0 .. 4 of K: true mounting ``exp(-theta_E) C_EK_model``, and true over model focal length."""
    minus_theta_E = (-sigma[0] * D[0], -sigma[0] * D[1], -sigma[0] * D[2])
    put_four(K, 0, multiply(turn(minus_theta_E), (q_model[0], q_model[1], q_model[2], q_model[3])))
    K[FOCAL] = 1.0 / (1.0 + sigma[1] * D[3])


def station(D: Array, K: Array, image: Array, L: Array, sigma: Array) -> None:
    """Rows 5 .. 15 of K: true C_KJ, aimed amiss; measured ``C_EJ = exp(alpha_E) C_EK C_KJ``; error of position.

    ``image``: r_J (3), quaternion of the wanted C_KJ (4), range (1); L (3, 3) root of the trackers' covariance.
    """
    tilt = sigma[2] / image[7]
    x = tilt * D[0]
    q_KJ = multiply(turn((x, tilt * D[1], 0.0 * x)), (image[3], image[4], image[5], image[6]))
    u = three(D, 2)
    alpha = (
        L[0, 0] * u[0] + L[0, 1] * u[1] + L[0, 2] * u[2],
        L[1, 0] * u[0] + L[1, 1] * u[1] + L[1, 2] * u[2],
        L[2, 0] * u[0] + L[2, 1] * u[1] + L[2, 2] * u[2],
    )
    put_four(K, CAMERA, q_KJ)
    put_four(K, TRACKER, multiply(turn(alpha), multiply(four(K, 0), q_KJ)))
    put_three(K, POSITION, (sigma[3] * D[5], sigma[3] * D[6], sigma[3] * D[7]))


def look(q_KJ: Quaternion, u_J: Triple, column: Row, row: Row, scale: Row) -> Triple:
    """Measured e_K: tangents with their noise, read with a focal length that is off by 1/scale."""
    s = rotate(q_KJ, u_J)
    depth = 1.0 / s[2]
    x, y = scale * (s[0] * depth + column), scale * (s[1] * depth + row)
    size = 1.0 / root(1.0 + x * x + y * y)
    return size * x, size * y, size


def sighting(D: Array, K: Array, S: Array, d: Triple, sigma: Array, floor: float) -> None:
    """Rows of a sighting: e_K, e_E, the axes of J (x, y, z of ITRF) in E, and the floor of gamma.

    ``d`` true vector from camera to marker.
    """
    q_EJ, rho_J = four(K, TRACKER), three(K, POSITION)
    e_K = look(four(K, CAMERA), d, sigma[4] * D[0], sigma[4] * D[1], K[FOCAL])
    e_E = rotate(q_EJ, unit((d[0] - rho_J[0], d[1] - rho_J[1], d[2] - rho_J[2])))
    c = axes(q_EJ)
    put_three(S, 0, e_K)
    put_three(S, E_E, e_E)
    put_three(S, AXES, c[0])
    put_three(S, AXES + 3, c[1])
    put_three(S, AXES + 6, c[2])
    S[FLOOR] = floor


def simulate_block(
    Z: Array,
    W: Array,
    K: Array,
    images: Array,
    p_J: Array,
    L: Array,
    q_model: Array,
    sigma: Array,
    floor: float,
) -> None:
    """Fill the sightings' rows of W and the rows of K (16, width) from a block of draws.

    ``images`` (m, 8) as in ``station``; ``p_J`` (n, 3) markers; ``sigma`` (5): initial error rad, focal length, aim m,
    GPS m, marker in tangents; ``q_model`` (4) quaternion of the model mounting.
    """
    begin(Z, K, q_model, sigma)
    base, first = STATE_ROWS, RUN_DRAWS
    for i in range(len(images)):
        station(Z[first : first + IMAGE_DRAWS], K, images[i], L, sigma)
        first += IMAGE_DRAWS
        for k in range(len(p_J)):
            d = (p_J[k, 0] - images[i, 0], p_J[k, 1] - images[i, 1], p_J[k, 2] - images[i, 2])
            D, S = Z[first : first + MARKER_DRAWS], W[base : base + SIGHTING_ROWS]
            sighting(D, K, S, d, sigma, floor)
            first += MARKER_DRAWS
            base += SIGHTING_ROWS


def start(W: Array, q_model: Array, P0: Array) -> None:
    """State before the first cycle: the model mounting, and P0 (3,) on the diagonal."""
    put_four(W, 0, (q_model[0], q_model[1], q_model[2], q_model[3]))
    put_six(W, STATE, (P0[0], 0.0, 0.0, P0[1], 0.0, P0[2]))


def error(W: Array, K: Array, E: Array) -> None:
    """Rows of E: ``theta_E = log(C_EK C_EK_true^T)`` by the series of the arc sine (to 1e-8 of itself up to 10 deg)."""
    q = multiply(four(W, 0), conjugate(four(K, 0)))
    s = q[0] * q[0] + q[1] * q[1] + q[2] * q[2]
    factor = 2.0 + s * (1.0 / 3.0 + s * (0.15 + s * (5.0 / 56.0)))
    put_three(E, 0, (factor * q[0], factor * q[1], factor * q[2]))


def campaign_blocks(
    Z: Array,
    images: Array,
    p_J: Array,
    L: Array,
    q_model: Array,
    sigma: Array,
    P0: Array,
    floor: float,
    parameters: Parameters,
    errors: Array,
    update: Update,
) -> None:
    """Draws (k, runs) to errors (cycles, 3, runs) rad about E after each cycle of the observer, a block at a time."""
    runs, all_rows = Z.shape[1], STATE_ROWS + SIGHTING_ROWS * len(images) * len(p_J)
    truth, memory = (np.empty((rows, min(runs, WIDTH))) for rows in (TRUTH_ROWS, all_rows))
    for begun in range(0, runs, WIDTH):
        D = Z[:, begun : begun + WIDTH]
        K, W = truth[:, : runs - begun], memory[:, : runs - begun]
        simulate_block(D, W, K, images, p_J, L, q_model, sigma, floor)
        start(W, q_model, P0)
        for cycle in range(len(errors)):
            one_cycle(W, parameters, update)
            error(W, K, errors[cycle, :, begun : begun + WIDTH])


def draws(scene: Scene) -> int:
    """Normal numbers that a run needs."""
    return RUN_DRAWS + len(scene.r_J) * (IMAGE_DRAWS + MARKER_DRAWS * len(scene.p_J))


def errors_E(scene: Scene, observer: Observer, Z: Array) -> Array:
    """Errors (cycles, 3, runs) rad about E that the observer leaves after each cycle, from unit normal draws
    (:func:`draws`, runs).

    Raises InputError for another order of the equations than that of J's axes.
    """
    if observer.order != (0, 1, 2):
        raise InputError(f"errors_E: found order = {observer.order}, wanted (0, 1, 2)")
    images = np.concatenate([scene.r_J, so3.to_quaternion(scene.C_KJ), scene.range_m[:, None]], axis=-1)
    root_E = np.asarray(np.linalg.cholesky(scene.tracker_covariance), dtype=np.float64)
    sigma = np.array([scene.initial, scene.focal_length, scene.aim, scene.gps, scene.marker * scene.pixel])
    P0 = np.array(np.broadcast_to(observer.P0, (3,)), dtype=np.float64)
    errors = np.empty((observer.cycles, 3, Z.shape[1]))
    campaign_blocks(
        Z,
        images,
        scene.p_J,
        root_E,
        so3.to_quaternion(C_EK_MODEL),
        sigma,
        P0,
        float(np.sqrt(observer.floor)),
        observer.parameters,
        errors,
        form(observer.factorised),
    )
    return errors
