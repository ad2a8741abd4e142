"""Sampled orbits and attitudes: accuracy on true motion, no joints, nothing beyond a burst, plain messages."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline, KroghInterpolator
from scipy.spatial.transform import Rotation, Slerp

from problems import UniformEarth
from starplumb.io.campaign.read import load_campaign
from starplumb.io.formats.sp3 import read_sp3
from starplumb.physics import so3
from starplumb.physics.earth import OMEGA_EARTH
from starplumb.physics.errors import EpochError, InputError
from starplumb.physics.series import Attitude, Bursts, Ephemeris
from starplumb.physics.units import ARCSEC, DEG
from starplumb.table.geometry import locate

EPOCH_NS = 600_000_000 * 1_000_000_000
GM, J2, RE = 3.986004418e14, 1.0826359e-3, 6378136.6


def ns(time_s):
    return EPOCH_NS + np.rint(np.asarray(time_s) * 1e9).astype(np.int64)


def _gravity(_, state):
    r, v = state[:3], state[3:]
    d = np.linalg.norm(r)
    z2 = 5 * (r[2] / d) ** 2
    bulge = 1.5 * J2 * (RE / d) ** 2 * np.array([1 - z2, 1 - z2, 3 - z2])
    return np.concatenate([v, -GM * r / d**3 * (1 + bulge)])


@pytest.fixture(scope="module")
def flight():
    """Dense solution of a low orbit about the oblate Earth, seen from axes that turn with it."""
    start = np.array([7058e3, 0, 0, 0, -1040.0, 7440.0])
    solution = solve_ivp(
        _gravity, (0, 1500), start, method="DOP853", rtol=1e-13, atol=1e-6, dense_output=True
    )

    def at(time_s):
        time_s = np.asarray(time_s, dtype=float)
        state = solution.sol(time_s).T
        angle = OMEGA_EARTH * time_s
        C = Rotation.from_rotvec(-angle[:, None] * np.array([0, 0, 1.0])).as_matrix()
        r, v = ((C @ part[..., None])[..., 0] for part in (state[:, :3], state[:, 3:]))
        return r, v - np.cross([0, 0, OMEGA_EARTH], r)

    return at


@pytest.mark.parametrize("with_v", [True, False])
@pytest.mark.parametrize(("spacing", "metres"), [(1, 1e-7), (10, 1e-6), (30, 5e-6), (60, 1e-5)])
def test_accuracy_on_a_real_orbit(flight, spacing, metres, with_v, rng):
    """Worst error inside the samples; at the ends, where the nodes lie on one side, ten times that."""
    samples = np.arange(0, 1201, spacing)
    r, v = flight(samples)
    orbit = Ephemeris(ns(samples), r, v if with_v else None)
    at = np.round(np.concatenate([rng.uniform(0, 1200, 400), [0.3 * spacing, 1200 - 0.4 * spacing]]), 6)
    found_r, found_v = orbit.at(ns(at))
    true_r, true_v = flight(at)
    inner = (at > 4 * spacing) & (at < 1200 - 4 * spacing)
    assert np.max(np.abs(found_r - true_r)[inner]) < metres
    assert np.max(np.abs(found_v - true_v)) < 1e-5
    assert np.max(np.abs(found_r - true_r)) < 10 * metres


def test_orbit_is_scipys_polynomial_through_the_same_nodes(flight):
    samples = np.arange(0, 121, 30.0)
    r, v = flight(samples)
    nodes = slice(1, 5)  # centred on the third interval
    with_v = KroghInterpolator(
        np.repeat(samples[nodes], 2), np.stack([r[nodes], v[nodes]], axis=1).reshape(-1, 3)
    )
    found, rate = Ephemeris(ns(samples), r, v).at(ns(75.0))
    np.testing.assert_allclose(found, with_v(75.0), atol=1e-7)
    np.testing.assert_allclose(rate, with_v.derivative(75.0), atol=1e-8)
    without = KroghInterpolator(samples, r)
    found, rate = Ephemeris(ns(samples), r).at(ns(75.0))
    np.testing.assert_allclose(found, without(75.0), atol=1e-7)
    np.testing.assert_allclose(rate, without.derivative(75.0), atol=1e-8)


def test_two_samples_with_velocities_make_the_cubic(flight):
    samples = np.array([0.0, 8.0])
    r, v = flight(samples)
    found, rate = Ephemeris(ns(samples), r, v).at(ns(3.0))
    cubic = CubicHermiteSpline(samples, r, v)
    np.testing.assert_allclose(found, cubic(3.0), atol=1e-8)
    np.testing.assert_allclose(rate, cubic(3.0, 1), atol=1e-8)


@pytest.mark.parametrize("with_v", [True, False])
def test_orbit_velocity_is_the_slope_and_samples_join(flight, with_v):
    samples = np.arange(0, 300, 20.0)
    r, v = flight(samples)
    orbit = Ephemeris(ns(samples), r, v if with_v else None)
    before, after = (orbit.at(ns(np.array([91.3, 155.0]) + h))[0] for h in (-0.05, 0.05))
    np.testing.assert_allclose((after - before) / 0.1, orbit.at(ns([91.3, 155.0]))[1], atol=2e-5)
    nodes = ns(samples[1:-1])
    step, speed = orbit.at(nodes + 1)[0] - orbit.at(nodes - 1)[0], v[1:-1]
    np.testing.assert_allclose(step, 2e-9 * speed, atol=5e-9)
    np.testing.assert_allclose(orbit.at(nodes)[0], r[1:-1], atol=2e-9)


def test_shapes_of_epochs_pass_through(flight):
    samples = np.arange(0, 300, 20.0)
    orbit = Ephemeris(ns(samples), *flight(samples))
    t = ns([[10.0, 30.0, 77.0], [80.0, 95.0, 120.0]])
    r, v = orbit.at(t)
    assert r.shape == v.shape == (2, 3, 3)
    np.testing.assert_array_equal(r[1, 2], orbit.at(t[1, 2])[0])
    assert orbit.at(t[0, 0])[0].shape == (3,)


BURSTS = np.concatenate([np.arange(0, 2.01, 0.25), np.arange(30, 32.01, 0.25), np.arange(60, 62.01, 0.25)])


@pytest.mark.parametrize(
    ("at_s", "says"),
    [
        (
            -0.5,
            r"outside the ephemeris \(which is never extrapolated\), .*; the nearest sample is 0\.5 s away, at 2019-01",
        ),
        (62.0 + 3e-6, "outside the ephemeris"),
        (
            2.1,
            r"in a gap of the ephemeris \(samples more than 0\.875 s apart are not joined\), .*; .* 0\.1 s away",
        ),
        (29.0, r"in a gap .* the nearest sample is 1 s away"),
    ],
)
def test_outside_and_in_a_gap_the_nearest_sample_is_named(flight, at_s, says):
    orbit = Ephemeris(ns(BURSTS), *flight(BURSTS))
    with pytest.raises(EpochError, match=says) as caught:
        orbit.at(ns([0.5, at_s, 31.0]))
    assert caught.value.row == 1
    q = Rotation.from_rotvec(BURSTS[:, None] * [0, 1e-3, 0]).as_quat()
    with pytest.raises(EpochError, match=says.replace("ephemeris", "attitude")):
        Attitude(ns(BURSTS), q, "ITRF").at(ns(at_s))


def test_a_burst_is_interpolated_from_its_own_samples_only(flight):
    """Moving the next burst by a kilometre changes nothing in this one, up to its last sample."""
    r, v = flight(BURSTS)
    elsewhere = np.where(BURSTS[:, None] > 20, r + 1e3, r)
    t = ns([0.0, 1.9, 2.0])
    for velocity in (v, None):
        found, _ = Ephemeris(ns(BURSTS), elsewhere, velocity).at(t)
        np.testing.assert_array_equal(found, Ephemeris(ns(BURSTS), r, velocity).at(t)[0])
    np.testing.assert_allclose(found, flight([0.0, 1.9, 2.0])[0], atol=1e-5)


def test_two_samples_with_a_gap_between_them_are_no_series(flight):
    """Nothing tells their rate; a stated gap, or velocities that tell what lies between, join them."""
    q = np.array([[0.0, 0.0, 0.0, 1.0]] * 2)
    near, far = ns([0.0, 9.0]), ns([0.0, 60.0])
    assert Attitude(near, q, "ITRF").bursts.covers(ns([4.5])).all()
    pair = Attitude(far, q, "ITRF")
    assert pair.bursts.covers(ns([0.0, 30.0, 60.0])).tolist() == [True, False, True]
    with pytest.raises(EpochError, match=r"in a gap of .*samples more than 10 s apart are not joined"):
        pair.at(ns([30.0]))
    assert Attitude(far, q, "ITRF", gap_s=60.0).bursts.covers(ns([30.0])).all()
    r, v = flight([0.0, 60.0])
    assert Ephemeris(far, r, v).bursts.covers(ns([30.0])).all()
    assert not Ephemeris(far, r, None).bursts.covers(ns([30.0])).any()


def test_a_stated_gap_overrules_the_median(flight):
    orbit = Ephemeris(ns(BURSTS), *flight(BURSTS), gap_s=40.0)
    # one curve across 28 s is rough, but was asked for
    np.testing.assert_allclose(orbit.at(ns([16.0]))[0], flight([16.0])[0], atol=0.5)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_microsecond_counts_as_the_sample_itself(flight, side):
    edge = 30.0 if side < 0 else 32.0
    t = ns(edge) + side * 1000
    orbit = Ephemeris(ns(BURSTS), *flight(BURSTS))
    np.testing.assert_allclose(orbit.at(t)[0], flight([edge])[0][0], atol=0.01)
    with pytest.raises(EpochError):
        orbit.at(t + side)
    q = Rotation.from_rotvec(BURSTS[:, None] * [0, 1e-3, 0]).as_quat()
    C, _ = Attitude(ns(BURSTS), q, "ITRF").at(t)
    np.testing.assert_allclose(so3.log(C), [0, 1e-3 * edge, 0], atol=2e-9)


def test_a_lone_sample_serves_its_own_epoch(flight):
    one = flight([5.0])
    with_v = Ephemeris(ns([5.0]), *one)
    np.testing.assert_array_equal(with_v.at(ns(5.0))[0], one[0][0])
    np.testing.assert_allclose(with_v.at(ns(5.0))[1], one[1][0])
    bare = Ephemeris(ns([5.0]), one[0])
    np.testing.assert_array_equal(bare.at(ns(5.0), velocity=False)[0], one[0][0])
    with pytest.raises(
        EpochError, match=r"only 1 sample and no velocities in .* around .*, wanted velocities"
    ):
        bare.at(ns(5.0))
    C, rate = Attitude(ns([5.0]), np.array([[0, 0, 1.0, 1.0]]), "ITRF").at(ns([5.0]))
    np.testing.assert_allclose(C[0] @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_array_equal(rate, np.zeros((1, 3)))


def test_three_positions_are_never_joined_by_lines(flight):
    samples = np.array([0.0, 1.0, 2.0])
    with pytest.raises(EpochError, match=r"only 3 samples .*at least 4 positions in a row"):
        Ephemeris(ns(samples), flight(samples)[0]).at(ns([1.5]), velocity=False)


@pytest.mark.parametrize("times", [[0.0, 2.0, 1.0], [0.0, 1.0, 1.0]])
def test_unsorted_and_repeated_samples_are_refused(times):
    with pytest.raises(InputError, match="sample 3 is not later than the one before it"):
        Bursts(ns(times))


def test_an_empty_series_is_refused():
    with pytest.raises(InputError, match="holds no sample"):
        Bursts(np.zeros(0, dtype=np.int64))


def test_velocities_in_other_units_or_axes_are_noticed(flight):
    samples = np.arange(0, 300, 20.0)
    r, v = flight(samples)
    with pytest.raises(InputError, match=r"differ from the motion of the positions by 7[0-9]{3} m/s"):
        Ephemeris(ns(samples), r, v / 1e3)
    with pytest.raises(InputError, match="relative to the turning Earth"):
        Ephemeris(ns(samples), r, v + np.cross([0, 0, OMEGA_EARTH], r))


STEPS_AND_SPANS = [
    (0.125, 2.0),
    (1.0, 5.0),
    (10.0, 10.0),
    (60.0, 60.0),
    (60.0, 1800.0),
    (300.0, 600.0),
    (900.0, 900.0),
]


@pytest.mark.parametrize(("step", "span"), STEPS_AND_SPANS)
def test_velocities_are_held_against_positions_at_any_step_and_span(flight, step, span):
    """Two samples a minute apart are enough, and fifteen minutes between them are not too much."""
    samples = np.arange(0, span + 0.5 * step, step)
    r, v = flight(samples)
    Ephemeris(ns(samples), r, v)
    with pytest.raises(InputError, match=r"\(they are 0\.1 times that motion: another unit\?\)"):
        Ephemeris(ns(samples), r, 0.1 * v)
    likely = r" \(they look like inertial velocities, turned into the axes of the"
    with pytest.raises(InputError, match=rf"by [0-9]{{3}} m/s{likely}"):
        Ephemeris(ns(samples), r, v + np.cross([0, 0, OMEGA_EARTH], r))
    turned = np.stack([v[:, 1], -v[:, 0], v[:, 2]], axis=-1)
    with pytest.raises(InputError, match=r"by [0-9]{3,5} m/s; wanted m/s"):
        Ephemeris(ns(samples), r, turned)


@pytest.mark.parametrize("step", [1.0, 10.0, 60.0])
def test_ten_metres_of_noise_are_not_mistaken_for_wrong_velocities(flight, step, rng):
    samples = np.arange(0, 601, step)
    r, v = flight(samples)
    noise = 10.0 * rng.standard_normal(r.shape)
    Ephemeris(ns(samples), r + noise, v + 0.1 * rng.standard_normal(v.shape))


def test_one_wrong_velocity_among_many_is_not_a_wrong_unit(flight):
    samples = np.arange(0, 601, 60.0)
    r, v = flight(samples)
    v[4] *= 10.0
    Ephemeris(ns(samples), r, v)


@pytest.mark.parametrize("case", ["right", "inertial", "tenth"])
def test_orbits_with_right_and_wrong_velocities(shared_cases, case):
    campaign = shared_cases / "velocity" / case / "campaign.toml"
    if case != "right":
        with pytest.raises(InputError, match=r"ephemeris\.csv: the velocities differ from the motion of the"):
            load_campaign(campaign)
        return
    loaded = load_campaign(campaign).campaign
    place = locate(loaded, loaded.C_EK, np.array([0]), 500.0, 500.0)
    np.testing.assert_allclose(place[0], [5091722.2, -652912.6, 3772635.7], atol=0.1)


@pytest.mark.parametrize("step", [1.0, 10.0, 60.0])
def test_inertial_velocities_are_noticed_near_the_pole_too(step):
    """At 85 degrees the Earth turns by 45 m/s below an orbit, which moves a place between samples by 0.1 of a step."""
    t = np.arange(0, 121, step)
    angle = np.radians(85.0) + 1.06e-3 * (t - 60.0)
    place, rate = 7.0e6 * np.stack([np.cos(angle), 0.0 * t, np.sin(angle)], axis=-1), 1.06e-3
    speed = 7.0e6 * rate * np.stack([-np.sin(angle), 0.0 * t, np.cos(angle)], axis=-1)
    turn = Rotation.from_rotvec(np.outer(-OMEGA_EARTH * t, [0.0, 0.0, 1.0]))
    r, v_I = turn.apply(place), turn.apply(speed)
    Ephemeris(ns(t), r, v_I - np.cross([0.0, 0.0, OMEGA_EARTH], r))
    with pytest.raises(InputError, match="they look like inertial velocities"):
        Ephemeris(ns(t), r, v_I)


def test_velocities_of_an_sp3_file_in_metres_per_second(shared_cases):
    table = read_sp3(shared_cases / "sp3" / "doris_ms.sp3")
    with pytest.raises(InputError, match=r"they are 0\.1 times that motion: another unit\?"):
        Ephemeris(table.t_ns, table.r, table.v)


STEP_ANGLES = [0.02 * ARCSEC, 2 * ARCSEC, 200 * ARCSEC, DEG, 60 * DEG]


@pytest.mark.parametrize("step", STEP_ANGLES)
def test_constant_rate_is_slerp(step, rng):
    samples = np.arange(0, 11) * 0.25
    axis = np.array([2.0, -1.0, 2.0]) / 3
    start = Rotation.random(random_state=5)
    truth = Rotation.from_rotvec(samples[:, None] / 0.25 * step * axis) * start
    at = rng.uniform(0, 2.5, 100)
    C, omega = Attitude(ns(samples), truth.as_quat(), "ITRF").at(ns(at))
    # epochs are whole nanoseconds
    expected = Slerp(samples, truth)((ns(at) - EPOCH_NS) * 1e-9).as_matrix()
    np.testing.assert_allclose(C, expected, atol=1e-14)
    np.testing.assert_allclose(omega, np.broadcast_to(step / 0.25 * axis, (100, 3)), rtol=1e-9, atol=1e-14)


def swinging(time_s):
    """A smooth turn with a changing rate: 1 deg swings in ten seconds on top of an orbital pitch rate."""
    t = np.asarray(time_s)[..., None]
    return Rotation.from_rotvec(
        (t * np.array([0, 1.1e-3, 0]) + DEG * np.sin(0.6 * t + np.array([0, 1, 2])))[..., :]
    )


def test_a_changing_rate_is_followed_to_a_tenth_of_an_arcsecond(rng):
    samples = np.arange(0, 20.01, 0.25)
    at = rng.uniform(1, 19, 300)
    C, _ = Attitude(ns(samples), swinging(samples).as_quat(), "ITRF").at(ns(at))
    error = so3.log(C @ swinging(at).as_matrix().mT)
    assert np.max(np.abs(error)) < 0.1 * ARCSEC


def test_signs_of_quaternions_do_not_matter(rng):
    samples = np.arange(0, 5.01, 0.25)
    q = swinging(samples).as_quat()
    flipped = q * rng.choice([-1.0, 1.0], len(q))[:, None]
    t = ns(rng.uniform(0, 5, 50))
    np.testing.assert_allclose(
        Attitude(ns(samples), flipped, "ITRF").at(t)[0], Attitude(ns(samples), q, "ITRF").at(t)[0], atol=1e-15
    )


@pytest.mark.parametrize("step", STEP_ANGLES[:-1])
def test_no_joint_where_the_nodes_change(step, rng):
    """Two nanoseconds across a sample turn the attitude by two nanoseconds of its rate, whatever the step's size."""
    samples = np.arange(0, 11) * 0.25
    vectors = np.cumsum(step * (np.array([0, 0, 1.0]) + 0.2 * rng.standard_normal((11, 3))), axis=0)
    series = Attitude(ns(samples), Rotation.from_rotvec(vectors).as_quat(), "ITRF")
    nodes = ns(samples[1:-1])
    jump = so3.log(series.at(nodes + 1)[0] @ series.at(nodes - 1)[0].mT)
    assert np.max(np.abs(jump)) < 2e-9 * 10 * step + 1e-15
    np.testing.assert_allclose(series.at(ns(samples))[0], so3.exp(vectors), atol=1e-15)


@pytest.mark.parametrize("frame", ["ITRF", "GCRF"])
def test_rate_by_differences(frame):
    """``d C_EJ/dt = [omega_E] C_EJ``, the turning Earth included where the samples are inertial."""
    samples = np.arange(0, 10.01, 0.25)
    series = Attitude(
        ns(samples), swinging(samples).as_quat(), frame, UniformEarth() if frame == "GCRF" else None
    )
    at, h = np.array([2.1, 3.33, 7.1]), 0.01
    (before, _), (_, omega), (after, _) = (series.at(ns(at + d)) for d in (-h, 0.0, h))
    np.testing.assert_allclose(so3.log(after @ before.mT) / (2 * h), omega, atol=2e-6)


def test_rate_of_a_coning_motion_by_differences():
    """The axis turns with the body by tens of degrees between samples: tangent and rate are not parallel."""
    samples = np.arange(0, 10.01, 1.0)
    cone = 0.5 * np.stack([np.cos(samples), np.sin(samples), 0.3 * samples], axis=-1)
    series = Attitude(ns(samples), Rotation.from_rotvec(cone).as_quat(), "ITRF")
    at, h = np.array([2.1, 3.33, 7.6]), 1e-3
    (before, _), (_, omega), (after, _) = (series.at(ns(at + d)) for d in (-h, 0.0, h))
    np.testing.assert_allclose(so3.log(after @ before.mT) / (2 * h), omega, atol=1e-6)


def test_an_inertial_attitude_is_brought_to_the_earth_by_its_orientation():
    """E along the inertial axes, an Earth turned by the angle a: E from J is the turn by +a about z."""
    series = Attitude(ns([0.0, 1.0]), np.array([[0, 0, 0, 1.0]] * 2), "GCRF", UniformEarth())
    C, omega = series.at(ns([0.5]))
    angle = OMEGA_EARTH * (ns(0.5) * 1e-9)
    np.testing.assert_allclose(C[0], Rotation.from_rotvec([0, 0, angle]).as_matrix(), atol=1e-9)
    np.testing.assert_allclose(omega[0], [0, 0, OMEGA_EARTH], rtol=1e-12)


def test_an_inertial_attitude_needs_an_earth():
    with pytest.raises(ValueError, match="orientation of the Earth"):
        Attitude(ns([0.0]), np.array([[0, 0, 0, 1.0]]), "GCRF")


def test_epochs_may_repeat_and_come_in_any_order(rng):
    samples = np.arange(0, 5.01, 0.25)
    series = Attitude(ns(samples), swinging(samples).as_quat(), "ITRF")
    t = ns(rng.choice(np.array([0.3, 4.4, 2.2]), (4, 5)))
    C, omega = series.at(t)
    assert C.shape == (4, 5, 3, 3)
    assert omega.shape == (4, 5, 3)
    np.testing.assert_array_equal(C[2, 3], series.at(t[2, 3])[0])
