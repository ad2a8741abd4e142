"""The fuzzy observer: its formulas against matrices written out, its signs by hand, its sigma against simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from observer_loop import cycle_run
from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.estimators.protocol import Status
from starplumb.estimators.published import observer_rows as rows
from starplumb.estimators.published import observer_run
from starplumb.estimators.published.observer import Observer, describe
from starplumb.physics import so3
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCMIN, ARCSEC, DEG
from starplumb.solve.compiled import is_kept
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure


def two_images(**changes):
    return observe(truth(FRAME, images=2, markers=2, shared_site=True, tilt_deg=2.5, **changes))


def measured(table, rng, runs):
    return measure(table, C_EK_TRUE, Errors.draw(table, rng, (runs,)))


def error_arcsec(estimate):
    return so3.log(estimate.C_EK @ C_EK_TRUE.T) / ARCSEC


def full(P):
    """Symmetric matrix of the rows (P11, P12, P13, P22, P23, P33)."""
    a, b, c, d, e, f = P
    return np.array([[a, b, c], [b, d, e], [c, e, f]])


def factors(P):
    """(D1, U12, U13, D2, U23, D3) of P = U D U^T, by hand from the last column up."""
    d3 = P[2, 2]
    u13, u23 = P[0, 2] / d3, P[1, 2] / d3
    d2 = P[1, 1] - d3 * u23**2
    u12 = (P[0, 1] - d3 * u13 * u23) / d2
    return P[0, 0] - d2 * u12**2 - d3 * u13**2, u12, u13, d2, u23, d3


def product(UD):
    d1, u12, u13, d2, u23, d3 = UD
    U = np.array([[1, u12, u13], [0, 1, u23], [0, 0, 1.0]])
    return U @ np.diag([d1, d2, d3]) @ U.T


@pytest.mark.parametrize("floor", [0.0, 1.0, 30.0])
def test_one_scalar_update_is_formula_3(rng, floor):
    A = rng.standard_normal((3, 3))
    P, g, z = A @ A.T, rng.standard_normal(3), 0.7
    alpha, beta, w = 0.3, 0.2, np.array([1.0, 2.0, 5.0])
    s = g @ P @ g
    K = P @ g / (alpha + s)
    Gamma = np.diag(np.sqrt(np.maximum(floor, w * z**2 / (beta + s))))
    wanted = Gamma @ (P - np.outer(K, g @ P)) @ Gamma
    parameters = (alpha, beta, *np.sqrt(w))
    P_plus, step = rows.update_plain(
        (P[0, 0], P[0, 1], P[0, 2], P[1, 1], P[1, 2], P[2, 2]), tuple(g), z, np.sqrt(floor), parameters
    )
    np.testing.assert_allclose(full(P_plus), wanted, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(step, K * z, rtol=1e-12)
    UD_plus, step = rows.update_factorised(factors(P), tuple(g), z, np.sqrt(floor), parameters)
    np.testing.assert_allclose(product(UD_plus), wanted, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(step, K * z, rtol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 1e-3, 0.3, 2.0, np.pi, 6.0])
def test_turn_is_the_exponential(rng, angle):
    axis = rng.standard_normal(3)
    v = angle * axis / np.linalg.norm(axis)
    rounding = 1e-14 if angle <= np.pi else 1e-12
    np.testing.assert_allclose(so3.from_quaternion(rows.turn(tuple(v))), so3.exp(v), atol=rounding)
    assert np.linalg.norm(rows.turn(tuple(v))) == pytest.approx(1.0, abs=rounding)


def test_rotations_of_rows_are_those_of_matrices(rng):
    p, q = (so3.to_quaternion(so3.exp(v)) for v in rng.standard_normal((2, 3)))
    v = rng.standard_normal(3)
    np.testing.assert_allclose(rows.rotate(tuple(q), tuple(v)), so3.from_quaternion(q) @ v, atol=1e-14)
    both = so3.from_quaternion(rows.multiply(tuple(p), tuple(q)))
    np.testing.assert_allclose(both, so3.from_quaternion(p) @ so3.from_quaternion(q), atol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("factorised", [True, False])
def test_a_model_turned_about_one_axis_is_turned_back(axis, factorised):
    table = observe(truth(FRAME, images=4, markers=6))
    model = so3.exp(10.0 * ARCMIN * np.eye(3)[axis]) @ C_EK_TRUE
    estimate = Observer(cycles=60, factorised=factorised)(table, model)
    assert np.linalg.norm(error_arcsec(estimate)) < 0.01
    # it found the error that was put in, with its sign
    found = so3.log(model @ estimate.C_EK.mT) / ARCMIN
    np.testing.assert_allclose(found, 10.0 * np.eye(3)[axis], atol=1e-3)


@pytest.mark.parametrize("camera", [FRAME, LINE])
@pytest.mark.parametrize("factorised", [True, False])
def test_two_cycles_are_those_of_the_loop_over_matrices(camera, factorised, rng):
    table = observe(truth(camera, images=2, markers=3))
    o = measured(table, rng, 20)
    model = so3.exp(rng.standard_normal((20, 3)) * DEG) @ C_EK_TRUE
    options = Observer(cycles=2, factorised=factorised)
    estimate = options(o, model)
    loop = [
        cycle_run(
            o.e_K[i],
            o.e_E[i],
            o.C_EJ[i],
            model[i],
            options.P0 * np.eye(3),
            alpha=options.alpha,
            beta=options.beta,
            w=options.w,
            floor=options.floor,
            cycles=2,
        )
        for i in range(20)
    ]
    difference = np.linalg.norm(so3.log(estimate.C_EK @ np.array(loop).mT), axis=-1)
    # gamma^2 ~ z^2 amplifies rounding, in single runs up to a milliarcsecond
    assert np.median(difference) < 1e-8 * ARCSEC
    assert np.max(difference) < 1e-2 * ARCSEC


def test_the_order_of_the_equations_is_that_of_the_axes_named(rng):
    table = measured(two_images(), rng, 5)
    model = so3.exp(rng.standard_normal((5, 3)) * DEG) @ C_EK_TRUE
    order = (2, 0, 1)
    turned = replace(table, C_EJ=table.C_EJ[..., list(order)])
    reordered = Observer(cycles=1, order=order)(table, model)
    np.testing.assert_allclose(reordered.C_EK, Observer(cycles=1)(turned, model).C_EK, atol=1e-15)
    assert np.max(np.abs(reordered.C_EK - Observer(cycles=1)(table, model).C_EK)) > 1e-6


def test_factorised_and_plain_agree_in_the_median(rng):
    table = measured(two_images(), rng, 500)
    model = so3.exp(rng.standard_normal((500, 3)) * DEG) @ C_EK_TRUE
    difference = so3.log(Observer()(table, model).C_EK @ Observer(factorised=False)(table, model).C_EK.mT)
    assert np.median(np.linalg.norm(difference, axis=-1)) < 1e-6 * ARCSEC


def test_a_batch_is_its_single_runs(rng):
    table = measured(two_images(), rng, 3)
    model = so3.exp(rng.standard_normal((3, 3)) * DEG) @ C_EK_TRUE
    together = Observer(cycles=3)(table, model)
    for i in range(3):
        alone = {name: getattr(table, name)[i] for name in ("xy_K", "C_EJ", "r_J", "p_J", "e_E", "range_m")}
        single = Observer(cycles=3)(replace(table, **alone), model[i])
        assert single.C_EK.shape == (3, 3)
        np.testing.assert_array_equal(single.C_EK, together.C_EK[i])
        assert single.status == together.status[i]


@pytest.mark.parametrize("factorised", [True, False])
def test_numbers_one_by_one_are_the_bits_of_rows(factorised, rng):
    observer = Observer(cycles=3, factorised=factorised)
    start, _ = observer._rows(measured(two_images(), rng, observer_run.FEW), C_EK_TRUE)
    update, trace = rows.form(factorised), np.empty((2, 3, 4, observer_run.FEW))
    rows.run_blocks(start, 3, observer.parameters, trace[0], update)
    observer_run.run(start, 3, observer.parameters, trace[1], factorised)
    np.testing.assert_array_equal(trace[1], trace[0])


def test_a_single_run_that_diverges_ends_as_rows_do():
    start = np.full((rows.STATE_ROWS + rows.SIGHTING_ROWS, 1), 1e308)  # its squares are infinite
    trace = np.zeros((2, 1, 4, 1))
    parameters = Observer().parameters
    with np.errstate(all="ignore"):
        rows.run_blocks(start, 1, parameters, trace[0], rows.update_plain)
        observer_run.run(start, 1, parameters, trace[1], factorised=False)
    assert not np.all(np.isfinite(trace[0]))
    np.testing.assert_array_equal(trace[1], trace[0])


@pytest.mark.parametrize("floor", [0.0, 1.0])
def test_a_marker_not_seen_changes_nothing(rng, floor):
    table = observe(truth(FRAME, images=2, markers=3))
    seen = np.array([True, True, False, True, True, True])
    model = so3.exp(rng.standard_normal(3) * DEG) @ C_EK_TRUE
    masked = Observer(floor=floor)(replace(table, weight=seen.astype(float)), model)
    np.testing.assert_allclose(masked.C_EK, Observer(floor=floor)(table.select(seen), model).C_EK, atol=1e-13)


def test_the_floor_keeps_the_weak_angle_from_freezing(rng):
    table = measured(two_images(), rng, 300)
    model = so3.exp(rng.standard_normal((300, 3)) * DEG) @ C_EK_TRUE
    free = np.std(error_arcsec(Observer()(table, model)), axis=0)
    frozen = np.std(error_arcsec(Observer(floor=0.0)(table, model)), axis=0)
    # about the line of sight
    assert np.max(frozen) > 3.0 * np.max(free)


def test_status_says_what_the_run_was_worth(rng):
    table = two_images()
    model = so3.exp(np.array([1.0, -0.5, 0.8]) * DEG) @ C_EK_TRUE
    assert Observer(cycles=40)(table, model).status == Status.OK
    assert Observer(cycles=2)(table, model).status == Status.WEAK
    one = table.select(np.array([True, False, False, False]))
    assert Observer()(one, model).status == Status.SINGULAR


def test_the_way_there_is_kept(rng):
    table = two_images()
    theta_E = np.array([1.0, -0.5, 0.3]) * DEG
    estimate = Observer(cycles=12)(table, so3.exp(theta_E) @ C_EK_TRUE)
    # the first equation knows nothing of the turn about its own line of sight
    sight = table.e_E[0]
    across = np.eye(3) - np.outer(sight, sight)
    np.testing.assert_allclose(
        across @ estimate.first_correction_E, across @ theta_E, atol=0.03 * np.linalg.norm(theta_E)
    )
    # beta between cycles: C(L - 1) = exp(beta) C(L)
    assert estimate.change_E.shape == (11, 3)
    np.testing.assert_allclose(
        so3.exp(estimate.change_E[0]) @ estimate.C_EK_after(2), estimate.C_EK_after(1), atol=1e-14
    )
    np.testing.assert_allclose(estimate.C_EK_after(12), estimate.C_EK, atol=1e-15)
    needed = int(estimate.cycles_needed)
    moved = np.linalg.norm(estimate.change_E, axis=-1)
    assert np.all(moved[needed - 1 :] < estimate.settle)
    assert needed == 1 or moved[needed - 2] >= estimate.settle


def test_described_in_words():
    model = so3.exp(np.array([1.0, -0.5, 0.8]) * DEG) @ C_EK_TRUE
    settled = " ".join(describe(Observer(cycles=30)(two_images(), model)))
    assert "very first equation put the initial error at" in settled
    assert "has settled: after cycle" in settled
    assert "NOT settled" in " ".join(describe(Observer(cycles=2)(two_images(), model)))
    assert "cannot be said" in " ".join(describe(Observer(cycles=1)(two_images(), model)))


def test_P_is_never_stated_as_a_covariance():
    assert Observer()(two_images(), C_EK_TRUE).covariance_E is None


def test_redrawn_covariance_is_that_of_the_errors(rng):
    table = two_images()
    o = measured(table, rng, 1500)
    model = so3.exp(np.array([0.5, -0.5, 0.5]) * DEG) @ C_EK_TRUE
    actual = np.sqrt(np.mean(error_arcsec(Observer()(o, model)) ** 2, axis=0))
    one = measured(table, rng, 1)
    single = replace(
        table, xy_K=one.xy_K[0], e_E=one.e_E[0], C_EJ=one.C_EJ[0], r_J=one.r_J[0], p_J=one.p_J[0]
    )
    estimate = Observer(covariance_draws=1500)(single, model)
    # 1500 runs on either side: 2.6 % of sampling error in the ratio, four times that allowed
    np.testing.assert_allclose(estimate.sigma_E / ARCSEC, actual, rtol=0.12)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"alpha": 0.0}, "alpha = 0.0, wanted a positive number"),
        ({"w": (1.0, -1.0, 1.0)}, "w = -1.0, wanted a positive number"),
        ({"P0": float("inf")}, "P0 = inf, wanted a positive number"),
        ({"cycles": 0}, "cycles = 0, wanted 1 or more"),
        ({"order": (0, 0, 1)}, "wanted the axes 0, 1, 2 each once"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, complaint):
    with pytest.raises(InputError, match=complaint.replace("(", r"\(")):
        Observer(**options)


@pytest.mark.slow
def test_one_run_has_the_same_bits_in_python_and_compiled(rng, monkeypatch):
    pytest.importorskip("numba")
    table = measured(two_images(), rng, 2)
    model = so3.exp(rng.standard_normal((2, 3)) * 10.0 * ARCMIN) @ C_EK_TRUE
    plain = Observer()(table, model)
    called = []
    monkeypatch.setattr(observer_run, "TO_COMPILE", 0)
    monkeypatch.setattr(observer_run, "_by_python", lambda *_: called.append(1))
    monkeypatch.setattr(observer_run, "is_kept", lambda _: pytest.fail("asked where even compiling pays"))
    np.testing.assert_array_equal(Observer()(table, model).trace_xyzw, plain.trace_xyzw)
    assert not called
    assert is_kept(observer_run.one_run)


def test_nothing_is_compiled_for_little_work_or_where_it_cannot_be_kept(rng, monkeypatch):
    table, model = measured(two_images(), rng, 1), so3.exp(np.array([1e-3, 0.0, 0.0])) @ C_EK_TRUE
    asked = []
    monkeypatch.setattr(observer_run, "is_kept", lambda _: False)
    monkeypatch.setattr(observer_run, "_compiled", lambda: asked.append(1))
    plain = Observer()(table, model)
    monkeypatch.setattr(observer_run, "TO_LOAD", 0)
    Observer()(table, model)
    assert not asked
    monkeypatch.setattr(observer_run, "TO_COMPILE", 0)
    np.testing.assert_array_equal(Observer()(table, model).trace_xyzw, plain.trace_xyzw)
    assert asked


@pytest.mark.parametrize(("times", "status"), [(1.01, Status.OK), (0.99, Status.WEAK)])
def test_an_answer_is_weak_where_the_last_cycle_moved_it_by_more_than_the_limit(times, status):
    """The limit just above and just below the very move of the last of three cycles."""
    model = so3.exp(np.array([1.0, -0.5, 0.8]) * DEG) @ C_EK_TRUE
    moved = np.linalg.norm(Observer(cycles=3)(two_images(), model).change_E, axis=-1)
    assert moved[0] > 1.1 * moved[1]
    found = Observer(cycles=3, settle=times * float(moved[1]))(two_images(), model)
    assert found.status == status
    assert found.cycles_needed == (2 if status is Status.OK else 0)
    assert found.describe(C_EK_TRUE)[-1] == (
        "settled by cycle 2" if status is Status.OK else "had not settled after its last cycle"
    )
    always = Observer(cycles=3, settle=1.01 * float(moved[0]))(two_images(), model)
    assert always.cycles_needed == 1
    assert Observer(cycles=1)(two_images(), model).status == Status.OK


@pytest.mark.parametrize(("apart", "status"), [(1e-8, Status.SINGULAR), (1e-7, Status.OK)])
def test_two_directions_that_rounding_cannot_tell_apart_are_one(apart, status):
    """Two unit vectors so many rad apart scatter by apart^2 / 4 each about their mean, against 1e-15."""
    table = two_images().select(np.array([0, 0]))
    e_E = np.array([[0.0, 0.0, 1.0], [0.0, apart, 1.0]])
    pair = replace(table, e_E=e_E, xy_K=np.array([[0.0, 0.0], [0.0, apart]]))
    assert Observer(settle=10.0)(pair, np.eye(3)).status == status


def test_what_an_unusable_answer_says_is_why(rng):
    one = two_images().select(np.array([0]))
    assert Observer()(one, C_EK_TRUE).describe(C_EK_TRUE) == (Status.SINGULAR.text,)
