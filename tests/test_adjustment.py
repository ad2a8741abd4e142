"""The shared-error solver against dense matrices written out here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from oracles import noise_of_pixels
from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.physics.covariance import square_root
from starplumb.physics.units import ARCSEC
from starplumb.solve import adjustment, chunks, schur
from starplumb.solve.adjustment import SharedErrors, solve
from starplumb.solve.normal import Pairs, eliminate, normal_equations
from starplumb.solve.problem import Problem
from starplumb.solve.tridiagonal import BlockTridiagonal
from starplumb.solve.whitening import Roots
from starplumb.table.equation import linearise
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure


def dense(o, model, A, information=None, step=None):
    """Same problem with one covariance of all observations: x, its covariance, alpha, rho, pi and chi-square."""
    n, m, L, width = o.n, o.n_images, o.n_landmarks, A.shape[-1]
    H, R_image, R_marker = (np.zeros((2 * n, 3 * count)) for count in (m, m, L))
    for j in range(n):
        rows, i, k = slice(2 * j, 2 * j + 2), 3 * o.image[j], 3 * o.landmark[j]
        H[rows, i : i + 3] = -model.H[j]
        R_image[rows, i : i + 3] = model.R[j]
        R_marker[rows, k : k + 3] = -model.R[j]
    spread = [(H, block_diag(*o.cov_attitude_E)), (R_image, block_diag(*o.cov_position_J))]
    spread.append((R_marker, block_diag(*o.cov_landmark_J)))
    V = noise_of_pixels(o) + sum(J @ cov @ J.T for J, cov in spread)
    kept = np.repeat(o.weight > 0, 2)
    W = np.zeros_like(V)
    W[np.ix_(kept, kept)] = np.linalg.inv(V[np.ix_(kept, kept)])
    A, z = A.reshape(2 * n, width), model.z_px.reshape(2 * n)
    information = np.zeros((width, width)) if information is None else information
    step = np.zeros(width) if step is None else step
    N = A.T @ W @ A + information
    x = -np.linalg.solve(N, A.T @ W @ z - information @ step) if width else np.zeros(0)
    w = z + A @ x
    chi2 = w @ W @ w + (x - step) @ information @ (x - step)
    shared = [(cov @ J.T @ W @ w).reshape(-1, 3) for J, cov in spread]
    return x, np.linalg.inv(N) if width else N, *shared, chi2


def check(o, model, A, found, information=None, step=None):
    x, covariance, alpha, rho, pi, chi2 = dense(o, model, A, information, step)
    sigma = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(found.x, x, atol=1e-7 * max([1e-30, *sigma]))
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-7, atol=1e-9 * max([1e-30, *sigma]) ** 2)
    shared = shared_errors(o, model, A, found.x)
    np.testing.assert_allclose(shared.alpha_E, alpha, atol=1e-6 * ARCSEC)
    np.testing.assert_allclose(shared.rho_J, rho, atol=1e-6)
    repeated = np.bincount(o.landmark, minlength=o.n_landmarks) > 1
    np.testing.assert_allclose(shared.pi_J[repeated], pi[repeated], atol=1e-6)
    np.testing.assert_array_equal(shared.pi_J[~repeated], 0.0)
    assert found.chi2 == pytest.approx(chi2, rel=1e-8)


def shared_errors(o, model, A, x):
    """The errors of images and landmarks at a solution."""
    roots = Roots.of(o)
    return SharedErrors.of(o, roots, adjustment.eliminated(o, roots, model, A)[0], x)


WAYS = ("dense", "images first", "landmarks first", "iterations")


@pytest.fixture(params=WAYS)
def way(request, monkeypatch):
    """How the shared errors are eliminated: as dense matrices, and as sparse ones by either side."""
    if request.param != "dense":
        take(request.param, monkeypatch)
        monkeypatch.setattr(adjustment, "eliminate", sparse_where_landmarks_are_seen_again)
    return request.param


def sparse_where_landmarks_are_seen_again(n, pairs):
    return schur.eliminate_sparse(n, pairs) if pairs.image.size else eliminate(n, pairs)


def take(way, monkeypatch):
    """One way through the sparse Schur complement, in steps of a size at which a small table has many."""
    monkeypatch.setattr(schur, "WINDOW", 100)
    monkeypatch.setattr(schur, "BLOCK", 1)
    first = (6, 3) if way == "images first" else (3, 6)
    work = schur.Plan.work.fget
    monkeypatch.setattr(schur.Plan, "work", property(lambda p: work(p) if p.sizes == first else np.inf))
    monkeypatch.setattr(schur, "SPARSE", 0.0 if way == "images first" else np.inf)
    if way == "iterations":
        monkeypatch.setattr(schur, "MOST_WORK", 0.0)


@pytest.fixture(params=["own", "site", "mixed"])
def problem(request, rng, way):
    """Own markers; one site; a site of which each image sees another part, one marker twice, and one image none."""
    o = observe(
        truth(
            LINE if request.param == "own" else FRAME, images=4, markers=6, shared_site=request.param != "own"
        )
    )
    if request.param == "mixed":
        keep = rng.permutation(o.n)[: o.n // 2]
        keep = np.append(keep[o.image[keep] != 2], keep[0])
        o = o.select(keep)
    return measure(o, C_EK_TRUE, Errors.draw(o, rng))


def test_alignment_is_the_dense_solution(problem):
    model = linearise(problem, C_EK_TRUE)
    check(problem, model, model.H, solve(problem, model, model.H))


def test_any_number_of_common_parameters(problem, rng):
    model = linearise(problem, C_EK_TRUE)
    for A in (
        model.H[..., :0],
        model.H[..., :1],
        np.concatenate([model.H, rng.standard_normal((problem.n, 2, 2))], -1),
    ):
        check(problem, model, A, solve(problem, model, A))


def test_prior(problem, rng):
    model = linearise(problem, C_EK_TRUE)
    root = rng.standard_normal((3, 3)) / ARCSEC
    information, step = root @ root.T, np.array([3.0, -2.0, 5.0]) * ARCSEC
    check(problem, model, model.H, solve(problem, model, model.H, information, step), information, step)


@pytest.mark.parametrize("zero", ["cov_attitude_E", "cov_position_J", "cov_landmark_J"])
def test_a_source_stated_as_zero(problem, zero):
    o = replace(problem, **{zero: np.zeros_like(getattr(problem, zero))})
    model = linearise(o, C_EK_TRUE)
    check(o, model, model.H, solve(o, model, model.H))


def test_an_error_stated_along_one_axis_only(problem):
    """A singular covariance: the height of the markers alone is unsure."""
    up = problem.p_J[0] / np.linalg.norm(problem.p_J[0])
    o = replace(problem, cov_landmark_J=np.broadcast_to(9.0 * np.outer(up, up), problem.cov_landmark_J.shape))
    model = linearise(o, C_EK_TRUE)
    check(o, model, model.H, solve(o, model, model.H))


def test_weight_zero_is_absence(problem, rng):
    weight = np.ones(problem.n)
    weight[rng.permutation(problem.n)[:3]] = 0.0
    o = replace(problem, weight=weight)
    model = linearise(o, C_EK_TRUE)
    found = solve(o, model, model.H)
    part = problem.select(weight > 0)
    model = linearise(part, C_EK_TRUE)
    expected = solve(part, model, model.H)
    np.testing.assert_allclose(found.x, expected.x, atol=1e-12)
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-8)
    assert found.chi2 == pytest.approx(expected.chi2)


def chain(rng):
    """Fourteen images in two parts: each meets the next two, some landmarks are seen once, one twice in an image."""
    o = observe(truth(FRAME, images=14, markers=24, tilt_deg=0.0))
    landmark = np.where(rng.random(o.n) < 0.2, o.landmark, 0)
    shared = np.flatnonzero(landmark == 0)
    first = o.image[shared] // 7 * 7
    landmark[shared] = 7 * first + 5 * (o.image[shared] - first) + rng.integers(12, size=shared.size)
    landmark[0] = landmark[1]
    return measure(replace(o, landmark=landmark), C_EK_TRUE, Errors.draw(o, rng))


@pytest.mark.slow
def test_a_chain_of_images_is_solved_block_by_block(way, rng):
    """Several blocks and two components, against one dense matrix."""
    o = chain(rng)
    model = linearise(o, C_EK_TRUE)
    check(o, model, model.H, solve(o, model, model.H))
    if way in ("images first", "landmarks first"):
        pairs, roots = Pairs.among(o, Roots.of(o)), Roots.of(o)
        plan = schur.plan(pairs, o.n_images, roots.repeated.size)
        assert plan.blocks.size > 5
        block = np.searchsorted(plan.blocks, plan.column, side="right") - 1
        assert np.all((block == plan.window[plan.row]) | (block == plan.window[plan.row] + 1))


@pytest.mark.parametrize(("images", "landmarks", "retained"), [(10, 200, 10), (100, 5, 5)])
def test_the_side_is_eliminated_that_leaves_less(images, landmarks, retained):
    """Of ten images of two hundred landmarks the landmarks, of a hundred images of five the images."""
    image, landmark = np.repeat(np.arange(images), landmarks), np.tile(np.arange(landmarks), images)
    plan = schur.plan(Pairs(image, landmark, np.arange(image.size)), images, landmarks)
    assert plan.retained.size == retained
    assert sorted(plan.retained) == list(range(retained))


def test_what_is_not_a_number_has_no_solution(way):
    o = observe(truth(FRAME, images=4, markers=9, shared_site=True))
    model = linearise(o, C_EK_TRUE)
    model.z_px[3] = np.nan
    with np.errstate(invalid="ignore"):
        try:
            assert not np.isfinite(solve(o, model, model.H).chi2)
        except np.linalg.LinAlgError:
            assert way != "dense"  # iterations and factors say so at once


def test_a_large_table_without_numbers_has_no_solution(monkeypatch):
    """And says so as any other: nothing is a number, and nothing is determined."""
    o = observe(truth(FRAME, images=4, markers=9, shared_site=True))
    o.e_E[3] = np.nan
    monkeypatch.setattr(chunks, "MANY", 0)
    problem = Problem(o, (), C_EK_TRUE, np.zeros(0), (np.zeros((3, 3)), np.zeros(3)))
    assert problem.in_chunks
    with np.errstate(invalid="ignore"):
        assert np.isnan(problem.solution.chi2)
        assert np.all(np.isnan(problem.shared_errors().pi_J))
    assert np.all(np.isinf(problem.solution.covariance))
    assert problem.tested() is None


def test_what_the_shared_errors_leave_is_the_pixel_noise_left(rng):
    o = observe(truth(FRAME, images=4, markers=9, shared_site=True))
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    model, roots = linearise(o, C_EK_TRUE), Roots.of(o)
    x = solve(o, model, model.H).x
    shared = shared_errors(o, model, model.H, x)
    noise = model.z_px + (model.H @ (x + shared.alpha_E[o.image])[..., None])[..., 0]
    noise -= (model.R @ (shared.rho_J[o.image] - shared.pi_J[o.landmark])[..., None])[..., 0]
    found = adjustment.eliminated(o, roots, model, model.H)[0]
    v = found.left(roots.design(o, model, model.H), o.image) @ np.append(x, 1.0)
    np.testing.assert_allclose(v * o.sigma_px[:, None], noise, atol=1e-9)


def test_order_of_sightings_and_names_of_images_do_not_matter(problem, rng):
    model = linearise(problem, C_EK_TRUE)
    expected = solve(problem, model, model.H)
    alpha_E = shared_errors(problem, model, model.H, expected.x).alpha_E
    shuffled = problem.select(rng.permutation(problem.n))
    turn = np.roll(np.arange(problem.n_images), 1)
    back = np.argsort(turn)
    o = replace(
        shuffled,
        image=turn[shuffled.image],
        cov_attitude_E=shuffled.cov_attitude_E[back],
        cov_position_J=shuffled.cov_position_J[back],
    )
    model = linearise(o, C_EK_TRUE)
    found = solve(o, model, model.H)
    np.testing.assert_allclose(found.x, expected.x, atol=1e-13)
    turned = shared_errors(o, model, model.H, found.x).alpha_E[turn]
    np.testing.assert_allclose(turned, alpha_E, atol=1e-13)
    assert found.chi2 == pytest.approx(expected.chi2)


@pytest.mark.parametrize("site", [False, True])
def test_batches_are_single_runs_side_by_side(site, rng):
    o = observe(truth(FRAME, images=3, markers=4, shared_site=site))
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng, (2, 3)))
    weight = np.ones((2, 3, o.n))
    weight[1, 2, :2] = 0.0
    o = replace(o, weight=weight)
    model = linearise(o, C_EK_TRUE)
    together = solve(o, model, model.H)
    errors = shared_errors(o, model, model.H, together.x)
    names = ("xy_K", "C_EJ", "r_J", "p_J", "e_E", "row_rate_E", "range_m", "weight")
    batched = {name: getattr(o, name) for name in names if getattr(o, name).shape[:2] == (2, 3)}
    one = replace(o, **{name: value[1, 2] for name, value in batched.items()})
    model = linearise(one, C_EK_TRUE)
    alone = solve(one, model, model.H)
    for name in ("x", "covariance", "chi2"):
        np.testing.assert_allclose(getattr(together, name)[1, 2], getattr(alone, name), rtol=1e-7, atol=1e-10)
    own = shared_errors(one, model, model.H, alone.x)
    for name in ("alpha_E", "rho_J", "pi_J"):
        np.testing.assert_allclose(getattr(errors, name)[1, 2], getattr(own, name), rtol=1e-7, atol=1e-10)


def test_what_is_not_determined_has_no_covariance_and_takes_no_step(problem):
    model = linearise(problem, C_EK_TRUE)
    A = np.concatenate([model.H[..., :1], np.zeros((problem.n, 2, 1))], axis=-1)
    found = solve(problem, model, A)
    assert np.all(np.isinf(found.covariance))
    np.testing.assert_array_equal(found.x, 0.0)
    twice = solve(problem, model, np.concatenate([model.H, model.H], axis=-1))
    assert np.all(np.isinf(twice.covariance))


def test_square_root(rng):
    M = rng.standard_normal((4, 3, 3))
    covariance = M @ M.mT
    S = square_root(covariance)
    np.testing.assert_allclose(S @ S.mT, covariance, atol=1e-13)
    np.testing.assert_array_equal(square_root(np.zeros((3, 3))), 0.0)


def test_many_markers_shared_by_many_images_stay_small_in_memory(rng):
    """Forty images of one site of 150 markers: nothing as large as rows times landmarks is formed."""
    import tracemalloc

    o = observe(truth(FRAME, images=40, markers=144, shared_site=True, tilt_deg=0.0))
    o = replace(o, sigma_px=np.full(o.n, 0.3))
    model = linearise(o, C_EK_TRUE)
    tracemalloc.start()
    solve(o, model, model.H)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    dense_rows = 2 * o.n * 3 * o.n_landmarks * 8
    assert peak < 0.5 * dense_rows


@pytest.mark.parametrize("way", WAYS[1:])
def test_blocks_of_the_inverse_are_those_of_the_dense_one(way, monkeypatch, rng):
    """Of images, of landmarks and of the pairs that meet; iterations have none."""
    o = chain(rng)
    model, roots = linearise(o, C_EK_TRUE), Roots.of(o)
    pairs = Pairs.among(o, roots)
    n = normal_equations(o, roots.design(o, model, model.H), pairs)
    expected = eliminate(n, pairs).cofactors()
    take(way, monkeypatch)
    found = schur.eliminate_sparse(n, pairs).cofactors()
    if way == "iterations":
        assert found is None
        return
    for name in ("image", "landmark", "pair"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-8, atol=1e-10)


def test_rounding_does_not_make_a_matrix_indefinite():
    """A singular one, of an image whose sightings all but fix it: two equal rows of ones."""
    factored = BlockTridiagonal.factor([np.ones((2, 2))], [])
    right = np.ones((2, 1))
    np.testing.assert_allclose(np.ones((2, 2)) @ factored.solve(right), right, rtol=1e-12)
