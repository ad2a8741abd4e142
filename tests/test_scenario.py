"""Scenarios: their files, their geometry, their error sources."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from problems import UniformEarth
from starplumb.estimators.gls import Gls
from starplumb.io.scenario.read import find_scenario, load_scenario, shipped_scenarios
from starplumb.physics import so3
from starplumb.physics.earth import C_JT, geodetic_to_itrf, itrf_to_geodetic
from starplumb.physics.errors import InputError
from starplumb.physics.orbit import KeplerOrbit, argument_of_latitude
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import marker_layout as layout
from starplumb.plan import passes
from starplumb.plan.bound import bound_E
from starplumb.plan.error_catalogue import Tracker, fused_axes
from starplumb.plan.scenario import Scenario
from starplumb.table import error_sources as sources
from starplumb.table.equation import residual_px
from starplumb.table.error_sources import Distribution, Effect, combine
from starplumb.table.simulate import Errors, measure

SMALL = """\
[scenario]
name = "small"
epoch = "2026-03-20T10:00:00"
[orbit]
model = "circular"
altitude_km = 500.0
inclination_deg = 97.4
[site]
latitude_deg = 43.5
longitude_deg = 4.9
[camera]
model = "frame"
focal_length_mm = 400.0
pixel_pitch_um = 4.5
image_size_px = [4096, 4096]
principal_point_px = [2047.5, 2047.5]
[[passes]]
pitch_deg = [10.0, 0.0, -10.0]
yaw_deg = [0.0, 90.0, 0.0]
[[passes]]
time_s = 86400.0
roll_deg = 8.0
pitch_deg = [5.0, -5.0]
[markers]
layout = "grid"
count = [3, 2]
extent_km = [12.0, 10.0]
[truth.tracker]
error = "attitude"
sigma_arcsec = [5.0, 5.0, 20.0]
[truth.gps]
error = "position"
sigma_m = 4.0
frame = "orbital"
[truth.survey]
error = "landmark"
sigma_m = [1.0, 1.0, 2.0]
[truth.pixel]
error = "pixel"
sigma_px = 0.3
"""


@pytest.fixture
def write(tmp_path):
    """Write SMALL, some of its text replaced, more added, and return its path."""

    def file(*changes, more=""):
        text = SMALL
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "scenario.toml"
        path.write_text(text + more, encoding="utf-8")
        return path

    return file


def source(scenario, name):
    return next(s for s in scenario.sources if s.name == name)


# -- files ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_every_shipped_scenario_loads_and_gls_solves_it_exactly():
    assert {"two-images", "cubesat-6u", "vhr-0.3m", "wide-swath"} <= set(shipped_scenarios())
    for name, path in shipped_scenarios().items():
        scenario = load_scenario(path)
        assert scenario.name == name
        assert scenario.description
        estimate = Gls()(scenario.stated, so3.exp(np.array([0.3, -0.2, 0.5])) @ scenario.C_EK_true)
        assert int(estimate.status) == 0
        assert np.abs(so3.log(estimate.C_EK @ scenario.C_EK_true.mT)).max() < 1e-12


def test_all_mistakes_are_told_at_once_each_with_its_key(write):
    path = write(("altitude_km = 500.0", 'altitude_km = "high"'), ("sigma_px = 0.3", "sigma_pix = 0.3"))
    with pytest.raises(InputError) as caught:
        load_scenario(path)
    message = str(caught.value)
    assert "\n" not in message
    for part in (
        str(path),
        "orbit.altitude_km",
        "truth.pixel.sigma_pix",
        "the nearest known one is sigma_px",
    ):
        assert part in message


@pytest.mark.parametrize(
    ("changes", "more", "said"),
    [
        (
            (("[truth.pixel]", "[truth.gps2]"), ('"pixel"\nsigma_px = 0.3', '"position"\nsigma_m = 1.0')),
            "",
            "truth: found no",
        ),
        ((), "[stated]\nomit = ['gpss']\n", 'stated.omit: found "gpss"'),
        ((), "[truth.a]\nerror = 'drift'\nsigma_m = 1\n", "truth.a.sigma_arcsec: missing"),
        ((), "[truth.a]\nerror = 'landmark'\nsigma_m = 1\nshared_by = 'pass'\n", "truth.a.shared_by"),
        ((), "[truth.a]\nerror = 'attitude'\nsigma_arcsec = 1\ntracker = 'T'\n", "truth.a.tracker"),
        ((('layout = "grid"', 'layout = "list"'),), "", "markers.east_north_km: missing"),
        ((("count = [3, 2]", "count = [3, 0]"),), "", "markers.count"),
        ((("yaw_deg = [0.0, 90.0, 0.0]", "yaw_deg = [0.0, 90.0]"),), "", "passes.0.yaw_deg: found 2 numbers"),
        ((("latitude_deg = 43.5", "latitude_deg = 95"),), "", "site.latitude_deg: found 95"),
        ((("latitude_deg = 43.5", "latitude_deg = 89.0"),), "", "inclination does not reach"),
        ((("inclination_deg = 97.4", "inclination_deg = 0.0"),), "", "inclination does not reach"),
        ((("extent_km = [12.0, 10.0]", "extent_km = 400.0"),), "", "markers: found 0 in the images"),
        ((("time_s = 86400.0", "time_s = 1.0"),), "", "overlap"),
        ((('epoch = "2026-03-20T10:00:00"', 'epoch = "soon"'),), "", "soon"),
        ((("altitude_km = 500.0", "altitude_km = 50.0"),), "", "orbit: found a perigee"),
        ((), "[images]\ntimes_s = [0.0]\n", "passes: found both"),
        ((), "[initial]\nstated = true\n", "initial.sigma_arcsec"),
    ],
)
def test_a_mistake_is_one_sentence_with_file_and_key(write, changes, more, said):
    path = write(*changes, more=more)
    with pytest.raises(InputError) as caught:
        load_scenario(path)
    assert str(path) in str(caught.value)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


TIMED = (
    ("[[passes]]\npitch_deg = [10.0, 0.0, -10.0]\nyaw_deg = [0.0, 90.0, 0.0]\n", ""),
    (
        "[[passes]]\ntime_s = 86400.0\nroll_deg = 8.0\npitch_deg = [5.0, -5.0]\n",
        "[images]\ntimes_s = [0.0, 20.0]\n",
    ),
)
"""Images at times of their own in place of the passes."""
LIST = (('layout = "grid"\ncount = [3, 2]\nextent_km = [12.0, 10.0]', 'layout = "list"\neast_north_km = 3'),)
FROM_FILE = (
    (
        'model = "circular"\naltitude_km = 500.0\ninclination_deg = 97.4',
        'model = "file"\nfile = "a"\nframe = "ITRF"',
    ),
)


@pytest.mark.parametrize(
    ("changes", "more", "said"),
    [
        # lists and their lengths
        ((("pitch_deg = [5.0, -5.0]", "pitch_deg = []"),), "", "passes.1.pitch_deg: found"),
        (LIST, "", "markers.east_north_km: found 3, wanted rows of two numbers, km"),
        ((("count = [3, 2]", "count = [3, 2, 1]"),), "", "markers.count: found"),
        ((("count = [3, 2]", "count = [3, true]"),), "", "markers.count: found"),
        (
            (("count = [3, 2]", "count = [1000000, 1000000]"),),
            "",
            "markers: found 1000000000000 markers to look for",
        ),
        ((), "[truth.a]\nerror = 'drift'\nsigma_arcsec = 1\nharmonics = [0]\n", "truth.a.harmonics: found"),
        ((), "[truth.a]\nerror = 'drift'\nsigma_arcsec = 1\nharmonics = [21]\n", "truth.a.harmonics: found"),
        # keys that do not belong together
        (
            (("altitude_km = 500.0", "altitude_km = 500.0\nperigee_deg = 3.0"),),
            "",
            "orbit.perigee_deg: found 3.0",
        ),
        ((("inclination_deg = 97.4\n", ""),), "", "orbit.inclination_deg: missing"),
        (
            (),
            "[mounting]\nfrom = 'pixel'\nto = 'star_tracker'\nrotation_vector_deg = [0, 0, 0]\n",
            'mounting.from: found "pixel" to "star_tracker", wanted "camera" on one side',
        ),
        (
            (("altitude_km = 500.0", "altitude_km = 500.0\nnode_deg = 3.0"),),
            "",
            "orbit.node_deg: found beside",
        ),
        (TIMED, "", "orbit.node_deg: missing"),
        (FROM_FILE, "", "passes.1.roll_deg: found for an orbit from a file"),
        ((), "[images]\nroll_deg = 1.0\n", "images.roll_deg: found it without times_s"),
        (TIMED[:1], "[images]\ntimes_s = [0.0]\n", "passes: found both"),
        ((TIMED[0], (TIMED[1][0], "")), "", "passes: found neither"),
        ((("[site]\nlatitude_deg = 43.5\nlongitude_deg = 4.9\n", ""),), "", "site: missing"),
        ((('layout = "grid"', 'layout = "list"\non = "image"'),), "", 'markers.on: found "image"'),
        (
            (("extent_km = [12.0, 10.0]", "extent = 0.5"),),
            "",
            "markers.extent_km: missing",
        ),
        # errors and what is stated of them
        ((), "[[trackers]]\nname = 'gps'\nsigma_arcsec = 1\n", 'truth: found the name "gps" twice'),
        ((), "[stated]\nfactor = { gpss = 2.0 }\n", 'stated.factor: found "gpss"'),
        ((), "[stated]\nomit = ['pixel']\n", "truth: found no stated error"),
        (
            (),
            "[truth.a]\nerror = 'position'\nsigma_m = 1\nshared_by = 'pass'\ncorrelation_time_s = 9.0\n",
            "truth.a.correlation_time_s: found it for an error that images share",
        ),
        (
            (),
            "[truth.a]\nerror = 'landmark'\nsigma_m = 1\ndegrees_of_freedom = 6\n",
            "truth.a.degrees_of_freedom: found it for another distribution",
        ),
        (
            (),
            "[[trackers]]\nname = 'T'\nsigma_arcsec = 1\nboresight = [0, 0, 1]\nrotation_vector_deg = [0, 0, 1]\n",
            "trackers.0.boresight: found beside rotation_vector_deg",
        ),
    ],
)
def test_every_rule_of_the_configuration_refuses_in_its_own_words(changes, more, said):
    text = SMALL
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    with pytest.raises(InputError) as caught:
        load_scenario(tomllib.loads(text + more))
    assert f": {said}" in str(caught.value)


def test_times_and_turns_of_images_in_place_of_passes():
    """By hand: 7.613 km/s at 97.4 deg and a ground that turns by 0.502 km/s at that height; the second image rolled."""
    text = SMALL.replace(
        "inclination_deg = 97.4", "inclination_deg = 97.4\nnode_deg = 0\nmean_anomaly_deg = 0"
    )
    for old, new in TIMED:
        text = text.replace(old, new)
    document = tomllib.loads(text)
    document["images"] |= {"roll_deg": [0.0, 10.0]}
    document["markers"] = {"layout": "ring", "on": "image", "count": 3, "extent": 0.5}
    o = load_scenario(document).truth
    assert np.bincount(o.image).tolist() == [3, 3]
    flown = np.linalg.norm(o.r_J[3] - o.r_J[0])
    speed = np.hypot(7613.0 * np.sin(97.4 * DEG), 7613.0 * np.cos(97.4 * DEG) - 502.0)
    assert flown == pytest.approx(20.0 * speed, rel=2e-3)
    assert np.linalg.norm(o.p_J[:3].mean(0) - o.p_J[3:].mean(0)) > 0.5 * flown
    off_nadir = np.arccos(
        -np.vecdot((o.p_J - o.r_J) / o.range_m[:, None], o.r_J) / np.linalg.norm(o.r_J, axis=-1)
    )
    np.testing.assert_allclose(
        [off_nadir[:3].mean() / DEG, off_nadir[3:].mean() / DEG], [0.0, 10.0], atol=1.0
    )


def test_an_unknown_name_is_told_the_shipped_ones():
    with pytest.raises(InputError, match=r"did you mean vhr-0\.3m"):
        find_scenario("vhr-03m")


# -- geometry ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ascending", [True, False])
@pytest.mark.parametrize("roll_deg", [-20.0, 0.0, 30.0])
def test_a_pass_sees_its_site_abeam_at_the_roll_and_on_the_way(ascending, roll_deg):
    """Checked by the geometry itself: distances from the ground track, and the sign of the vertical speed."""
    earth, shape = UniformEarth(), KeplerOrbit(7000e3, 0.001, 98 * DEG, 0.0, 0.3, 0.0)
    orbit = passes.pass_over(shape, earth, 10**15, (0.7, 0.2), roll_deg * DEG, ascending)
    r_I, v_I = orbit.at(0.0)
    site_I = earth.C_IJ(np.int64(10**15)) @ geodetic_to_itrf(0.7, 0.2, 0.0)
    look = site_I - r_I
    assert (v_I[2] > 0) == ascending
    across = np.cross(r_I, v_I)  # to the left of the flight
    angle = np.arctan2(look @ across / np.linalg.norm(across), -look @ r_I / np.linalg.norm(r_I))
    assert angle / DEG == pytest.approx(roll_deg, abs=1e-6)


def test_images_of_a_pass_are_taken_at_their_pitch_and_look_at_the_site(write):
    scenario = load_scenario(write(("count = [3, 2]", "count = [1, 1]")))
    pixel = scenario.campaign.sightings
    # aberration and light time, 5 arcsec, are 2.3 pixels: aiming is geometric
    np.testing.assert_allclose(pixel.column_px, 2047.5, atol=3.0)
    np.testing.assert_allclose(pixel.row_px, 2047.5, atol=3.0)
    o = scenario.truth
    down = -o.r_J / np.linalg.norm(o.r_J, axis=-1, keepdims=True)
    look = (o.p_J - o.r_J) / np.linalg.norm(o.p_J - o.r_J, axis=-1, keepdims=True)
    ahead = np.sum(look * o.v_J, axis=-1) > 0
    assert ahead.tolist() == [True, ahead[1], False, True, False]
    off_nadir = np.arccos(np.sum(look * down, axis=-1)) / DEG
    np.testing.assert_allclose(off_nadir[[0, 1, 2]], [10.0, 0.0, 10.0], atol=1.0)
    np.testing.assert_allclose(off_nadir[[3, 4]], np.hypot(5.0, 8.0), atol=0.3)


def test_very_high_resolution_field_has_the_rms_radius_5_km():
    scenario = load_scenario(find_scenario("vhr-0.3m"))
    assert (scenario.truth.n_images, scenario.truth.n) == (30, 900)
    for image in range(30):
        tangents = scenario.truth.xy_K[scenario.truth.image == image]
        radius = np.sqrt(np.mean(np.sum((tangents - tangents.mean(0)) ** 2, axis=-1)))
        assert 617e3 * radius == pytest.approx(5000.0, rel=0.002)


def test_argument_of_latitude_grows_from_the_node(rng):
    orbit = KeplerOrbit(7000e3, 0.0, 1.2, 0.4, 0.0, 0.9, j2=0.0)
    assert argument_of_latitude(*orbit.at(0.0)) == pytest.approx(0.9)
    r, v = orbit.at(1.0)
    assert argument_of_latitude(r, v) - 0.9 == pytest.approx(np.linalg.norm(v) / 7000e3, rel=1e-6)


def test_layouts():
    assert layout.grid(1, 1).tolist() == [[0.0, 0.0]]
    assert sorted(map(tuple, np.sign(layout.ring(4)).tolist())) == [(-1, -1), (-1, 1), (1, -1), (1, 1)]
    np.testing.assert_allclose(np.linalg.norm(layout.ring(7), axis=-1), 1.0)
    assert np.abs(layout.scattered(1000, np.random.default_rng(1))).max() <= 1.0


def test_ground_displacement_of_a_roll_is_range_times_angle(write):
    scenario = load_scenario(
        write(("pitch_deg = [10.0, 0.0, -10.0]\nyaw_deg = [0.0, 90.0, 0.0]", "pitch_deg = [0.0]"))
    )
    move = scenario.ground_m[0] @ scenario.C_EK_true @ np.array([1e-6, 0.0, 0.0])
    assert np.linalg.norm(move) == pytest.approx(1e-6 * scenario.truth.range_m[0], rel=2e-3)


def test_a_line_scanner_sees_the_markers_of_a_site_that_lie_in_its_strip(write):
    """A strip of 4096 rows of 5.6 m is 23 km long: of markers 20 km apart along the track it holds one, not all."""
    changes = [
        ('model = "frame"', 'model = "line-scan"'),
        ("yaw_deg = [0.0, 90.0, 0.0]", "yaw_deg = 0.0"),
        ("count = [3, 2]", "count = [1, 11]"),
        ("extent_km = [12.0, 10.0]", "extent_km = [1.0, 200.0]"),
    ]
    scenario = load_scenario(write(*changes))
    assert np.bincount(scenario.truth.image).tolist() == [1, 1, 1, 1, 1]
    assert scenario.truth.n_landmarks == 11


# -- error sources ----------------------------------------------------------------------------------------------------

EVERY = """\
[[trackers]]
name = "A"
sigma_arcsec = [4.0, 4.0, 20.0]
boresight = [1.0, 0.0, 0.0]
[[trackers]]
name = "B"
sigma_arcsec = [4.0, 4.0, 20.0]
boresight = [0.0, 1.0, 0.0]
[truth.pass]
error = "attitude"
shared_by = "pass"
sigma_arcsec = 3.0
[truth.bias]
error = "attitude"
tracker = "A"
shared_by = "campaign"
sigma_arcsec = [2.0, 2.0, 5.0]
[truth.drift]
error = "drift"
sigma_arcsec = [4.0, 3.0, 2.0]
harmonics = [1, 3]
[truth.slow]
error = "position"
sigma_m = 3.0
correlation_time_s = 50.0
frame = "GCRF"
[truth.calm]
error = "attitude"
sigma_arcsec = [2.0, 3.0, 4.0]
correlation_time_s = 40.0
[truth.wander]
error = "wander"
sigma_arcsec = [2.0, 3.0, 4.0]
correlation_time_s = 1.0
[truth.datum]
error = "landmark"
sigma_m = 0.5
shared_by = "campaign"
[truth.clock]
error = "time-tag"
sigma_ms = 0.5
[truth.focal]
error = "focal-length"
sigma_ppm = 300.0
distribution = "uniform"
[truth.centre]
error = "principal-point"
sigma_px = 1.0
distribution = "student"
degrees_of_freedom = 6
[truth.rounding]
error = "rounding"
step_px = 1.0
[truth.air]
error = "refraction"
sigma_percent = 50.0
[truth.chips]
error = "landmark"
sigma_m = [0.5, 1.0, 2.0]
correlation_length_m = 4000.0
"""
NAMES = ["A", "B", "tracker", "gps", "survey", "pixel", "pass", "bias", "drift", "slow", "calm", "wander", "datum",
         "clock", "focal", "centre", "rounding", "air", "chips"]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("scans", [False, True])
def test_effect_of_every_source_is_the_change_of_the_residual(write, name, scans):
    """Against the simulator and the measurement equation themselves, by differences over a thousandth of a sigma."""
    turned = "yaw_deg = [0.0, 90.0, 0.0]"
    changes = [('model = "frame"', 'model = "line-scan"'), (turned, "yaw_deg = 0.0")] if scans else []
    scenario = load_scenario(write(*changes, more=EVERY))
    one, step = source(scenario, name), 1e-3
    xi = np.eye(one.groups * one.component.size).reshape(-1, one.groups, one.component.size)

    def residual(scale):
        errors = combine(scenario.truth, [(one.field, one.error(scale * xi))])
        return residual_px(measure(scenario.truth, scenario.C_EK_true, errors), scenario.C_EK_true)

    wanted = np.moveaxis(residual(step) - residual(-step), 0, -1) / (2.0 * step)
    found = Effect.of(one, scenario.truth, scenario.model).columns()
    np.testing.assert_allclose(found, wanted, atol=3e-4 * np.abs(wanted).max())


LOOKS = """
[truth.looks]
error = "look-angles"
sigma_px = 0.5
"""


def test_look_angles_err_by_their_sigma_at_the_ends_of_the_line(write):
    """Half a pixel for each term at the ends; the bound by dense matrices is the covariance of the estimate."""
    changes = [('model = "frame"', 'model = "line-scan"'), ("yaw_deg = [0.0, 90.0, 0.0]", "yaw_deg = 0.0")]
    scenario = load_scenario(write(*changes, more=LOOKS))
    one, camera = source(scenario, "looks"), scenario.campaign.camera
    column = camera.px_from_tan(scenario.truth.xy_K)[:, 0]
    u = 2.0 * (column - camera.column_px[0]) / np.ptp(camera.column_px) - 1.0
    pixel = np.abs(np.diff(camera.tan_x[[0, -1]]) / np.diff(camera.column_px[[0, -1]]))[0]
    assert one.labels == ("look_x_1", "look_x_2", "look_x_3", "look_y_2", "look_y_3")
    np.testing.assert_allclose(
        np.abs(one.gain[:, 0, 1]), 0.5 * pixel * np.abs(3.0 * u**2 - 1.0) / 2.0, rtol=1e-6
    )
    stated = Gls()(scenario.stated, scenario.C_EK_true).covariance_E
    np.testing.assert_allclose(stated, bound_E(scenario), rtol=1e-6, atol=1e-9 * np.trace(stated))
    plain = Gls()(load_scenario(write(*changes)).stated, scenario.C_EK_true).sigma_E
    assert np.max(np.sqrt(np.diag(stated)) / plain) > 1.05


def test_look_angles_of_a_frame_camera_are_refused(write):
    with pytest.raises(InputError, match=r"truth\.looks: found look-angles for a frame camera"):
        load_scenario(write(more=LOOKS))


def test_stated_table_has_the_covariance_of_the_sources(write):
    """What the table says in its several places adds up to V = sum E E^T."""
    scenario = load_scenario(write(more=EVERY))
    o, model = scenario.stated, scenario.model
    V = np.diag(np.repeat(o.sigma_px**2, 2)) + (c := o.common_px.reshape(2 * o.n, -1)) @ c.T
    for jacobian, covariance, index in (
        (model.H, o.cov_attitude_E, o.image),
        (model.R, o.cov_position_J, o.image),
        (model.R, o.cov_landmark_J, o.landmark),
    ):
        block = np.einsum("nia,nab,kjb->nikj", jacobian, covariance[index], jacobian)
        V += (block * (index[:, None, None, None] == index[None, None, :, None])).reshape(V.shape)
    wanted = sum(Effect.of(s, scenario.truth, model).covariance() for s in scenario.sources)
    np.testing.assert_allclose(V, wanted, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize(
    ("shape", "kurtosis"),
    [(Distribution(), 3.0), (Distribution("uniform"), 1.8), (Distribution("student", 12.0), 3.0 + 6.0 / 8.0)],
)
def test_draws_have_mean_0_variance_1_and_their_own_tails(rng, shape, kurtosis):
    xi = shape.draw(rng, (200_000, 1, 1)).reshape(-1)
    assert abs(xi.mean()) < 0.01
    assert xi.var() == pytest.approx(1.0, abs=0.015)
    assert np.mean(xi**4) == pytest.approx(kurtosis, rel=0.05)


def test_blunders_hit_whole_sightings_at_their_rate(rng):
    xi = Distribution("blunder", rate=0.1).draw(rng, (1000, 50, 2))
    hit = xi != 0.0
    assert np.array_equal(hit[..., 0], hit[..., 1])
    assert hit.mean() == pytest.approx(0.1, abs=0.005)


def test_shared_errors_are_shared(write, rng):
    scenario = load_scenario(write(more=EVERY))
    drawn = {name: source(scenario, name).draw(rng, (7,)) for name in NAMES}
    assert np.ptp(drawn["pass"][:, :3], axis=1).max() == 0.0
    assert np.ptp(drawn["pass"][:, [0, 3]], axis=1).min() > 0.0
    assert np.ptp(drawn["bias"], axis=1).max() == 0.0
    assert np.ptp(drawn["tracker"], axis=1).min() > 0.0
    assert np.ptp(drawn["clock"], axis=1).max() == 0.0
    east = np.einsum(
        "lij,blj->bli", C_JT(*itrf_to_geodetic(scenario.campaign.landmarks.r_J)[:2]).mT, drawn["datum"]
    )
    assert np.ptp(east, axis=1).max() < 1e-4


IN_IMAGES = 'layout = "ring"\non = "image"\ncount = 3\nextent = 0.5'
SHARED = "[truth.shared]\nerror = 'attitude'\nsigma_arcsec = 3.0\nshared_by = '{}'\n"


@pytest.mark.parametrize(("second", "alike"), [("first", True), ("second", False), (None, False)])
def test_passes_of_one_session_share_its_draw(write, rng, second, alike):
    path = write(
        ("yaw_deg = [0.0, 90.0, 0.0]", "yaw_deg = [0.0, 90.0, 0.0]\nsession = 'first'"),
        ("roll_deg = 8.0", "roll_deg = 8.0" + (f"\nsession = '{second}'" if second else "")),
        more=SHARED.format("session"),
    )
    drawn = source(load_scenario(path), "shared").draw(rng, ())
    assert np.ptp(drawn[:3], axis=0).max() == 0.0
    assert bool(np.all(drawn[0] == drawn[3])) is alike


@pytest.mark.parametrize("shared_by", ["pass", "session"])
def test_images_at_times_are_one_pass_where_less_than_half_an_orbit_apart(write, rng, shared_by):
    """As in a campaign that names no passes; half an orbit is 47 minutes."""
    changes = [(old, new.replace("[0.0, 20.0]", "[0.0, 20.0, 2600.0, 8000.0]")) for old, new in TIMED]
    changes.append(("inclination_deg = 97.4", "inclination_deg = 97.4\nnode_deg = 0\nmean_anomaly_deg = 0"))
    changes.append(('layout = "grid"\ncount = [3, 2]\nextent_km = [12.0, 10.0]', IN_IMAGES))
    path = write(*changes, more=SHARED.format(shared_by))
    drawn = source(load_scenario(path), "shared").draw(rng, ())
    assert np.ptp(drawn[:3], axis=0).max() == 0.0
    assert np.all(drawn[3] != drawn[0])


def test_gauss_markov_error_forgets_itself(write, rng):
    scenario = load_scenario(write(more=EVERY))
    rho = source(scenario, "slow").draw(rng, (20_000,))
    t = 1e-9 * (scenario.campaign.images.t_ns - scenario.campaign.images.t_ns[0])
    C_IJ = scenario.campaign.orientation.C_IJ(scenario.campaign.images.t_ns)
    rho_I = np.einsum("mij,bmj->bmi", C_IJ, rho)
    np.testing.assert_allclose(rho_I.std(0), 3.0, rtol=0.03)
    for k in range(1, len(t)):
        correlation = np.mean(rho_I[:, 0] * rho_I[:, k], axis=0) / 9.0
        np.testing.assert_allclose(correlation, np.exp(-abs(t[k]) / 50.0), atol=0.03)


def test_mean_and_weighted_fusion_of_two_crossed_trackers():
    """By hand: trackers along x and y, sigmas 1, 1, 3.  About x: 3 and 1; about z: 1 and 1."""
    C_x = so3.exp(np.array([0.0, 0.5 * np.pi, 0.0]))  # takes the tracker's z to E's x
    C_y = so3.exp(np.array([-0.5 * np.pi, 0.0, 0.0]))
    trackers = tuple(Tracker(n, C, np.array([1.0, 1.0, 3.0])) for n, C in (("x", C_x), ("y", C_y)))
    variance = {}
    for fusion in ("mean", "weighted"):
        axes = fused_axes(trackers, fusion)
        variance[fusion] = np.diag(
            sum(W @ np.diag(t.sigma**2) @ W.T for W, t in zip(axes, trackers, strict=True))
        )
    np.testing.assert_allclose(variance["mean"], [10.0 / 4.0, 10.0 / 4.0, 2.0 / 4.0])
    np.testing.assert_allclose(variance["weighted"], [0.9, 0.9, 0.5])


def test_stated_errors_may_differ_from_the_true_ones(write):
    scenario = load_scenario(write(more='[stated]\nomit = ["gps"]\nfactor = { tracker = 0.5 }\n'))
    assert not scenario.model_is_true
    assert np.all(scenario.stated.cov_position_J == 0.0)
    np.testing.assert_allclose(
        np.sqrt(np.diagonal(scenario.stated.cov_attitude_E[0])) / ARCSEC, [2.5, 2.5, 10.0]
    )
    assert scenario.digest != replace(scenario, stated_sources=scenario.sources).digest


def test_focal_error_scales_the_field_and_a_late_clock_shifts_along_the_track(write):
    """By hand: a focal length 300 ppm too long shrinks tangents by 300 ppm; 1 ms late is 7 m along the track."""
    scenario = load_scenario(write(more=EVERY))
    o = scenario.truth
    focal = source(scenario, "focal")
    assert focal.error(np.ones((1, 1)))[5] == pytest.approx(-3e-4 * o.xy_K[5])
    clock = source(scenario, "clock")
    errors = combine(o, [(clock.field, clock.error(np.full((1, 1), 2.0)))])
    shifted = measure(o, scenario.C_EK_true, errors)
    np.testing.assert_allclose(shifted.r_J - o.r_J, 1e-3 * o.v_J, rtol=1e-9)


def test_sources_module_combines_fields_by_adding(write, rng):
    scenario = load_scenario(write(more=EVERY))
    one = sources.draw(scenario.truth, scenario.sources, rng, (2,))
    assert one.alpha_E.shape == (2, 5, 3)
    assert one.tangent.shape == (2, scenario.truth.n, 2)


# -- from Python ------------------------------------------------------------------------------------------------------


def test_a_dictionary_is_the_same_scenario_as_its_file(write):
    """Also with tuples and arrays in place of TOML's lists."""
    path = write(more=EVERY)
    document = tomllib.loads(path.read_text("utf-8"))
    document["markers"] |= {"count": (3, 2), "extent_km": np.array([12.0, 10.0])}
    document["truth"]["pixel"]["sigma_px"] = np.float64(0.3)
    document["passes"] = tuple(document["passes"])
    assert load_scenario(document).digest == load_scenario(path).digest


def test_a_shipped_name_is_the_same_scenario_as_its_file():
    assert load_scenario("two-images").digest == load_scenario(shipped_scenarios()["two-images"]).digest


def test_mistakes_in_a_dictionary_are_those_of_a_file(write):
    path = write(("altitude_km = 500.0", 'altitude_km = "high"'), ("sigma_px = 0.3", "sigma_pix = 0.3"))
    with pytest.raises(InputError) as of_file:
        load_scenario(path)
    with pytest.raises(InputError) as of_dictionary:
        load_scenario(tomllib.loads(path.read_text("utf-8")))
    assert str(of_dictionary.value) == str(of_file.value).replace(str(path), "scenario")
    with pytest.raises(InputError, match=r"^scenario: orbit: found a perigee"):
        load_scenario(tomllib.loads(SMALL.replace("altitude_km = 500.0", "altitude_km = 50.0")))


def test_files_of_a_dictionary_stand_in_the_given_folder(tmp_path):
    (tmp_path / "marks.csv").write_text(
        "landmark_id,latitude_deg,longitude_deg,height_m,sigma_m\nA,43.5,4.9,0,1\nB,43.51,4.92,9,1\n"
    )
    document = tomllib.loads(SMALL)
    document["markers"] = {"layout": "file", "file": tmp_path.joinpath("marks.csv").name}
    assert load_scenario(document, tmp_path).truth.n_landmarks == 2
    with pytest.raises(InputError, match=r"^marks\.csv: "):
        load_scenario(document)


def test_a_scenario_from_plain_objects_is_that_of_its_file(write):
    """The campaign and the sources that the file describes, put together by hand."""
    read = load_scenario(write(more='[stated]\nomit = ["gps"]\nfactor = { tracker = 0.5 }\n'))
    made = Scenario.of(
        read.campaign, read.sources, omit=["gps"], factor={"tracker": 0.5}, initial=read.initial
    )
    assert made.digest == read.digest
    assert made.name == "small"
    start = Scenario.of(read.campaign, read.sources)
    assert start.model_is_true
    assert start.prior_E is None
    assert np.array_equal(start.initial.sigma, np.zeros(3))


# -- one noise model --------------------------------------------------------------------------------------------------


def test_sources_of_a_stated_table_have_the_covariance_of_the_sources_it_states(write):
    """There and back: sources into a table's covariances and common errors, and those as sources again."""
    scenario = load_scenario(write(more=EVERY))
    of_table = sources.stated_sources(scenario.stated)

    def V(these):
        return sum(Effect.of(s, scenario.truth, scenario.model).covariance() for s in these)

    wanted = V(scenario.sources)
    np.testing.assert_allclose(V(of_table), wanted, atol=1e-9 * np.abs(wanted).max())


def test_errors_drawn_from_a_table_have_its_covariance(write, rng):
    """By sampling: residuals of simulated tables against the covariance of the true sources, common errors included."""
    scenario = load_scenario(write(more=EVERY))
    runs = 20_000
    drawn = measure(scenario.truth, scenario.C_EK_true, Errors.draw(scenario.stated, rng, (runs,)))
    z = residual_px(drawn, scenario.C_EK_true).reshape(runs, -1)
    wanted = sum(Effect.of(s, scenario.truth, scenario.model).covariance() for s in scenario.sources)
    scale = np.sqrt(np.diag(wanted))
    found = z.T @ z / runs / np.outer(scale, scale)
    np.testing.assert_allclose(found, wanted / np.outer(scale, scale), atol=6.0 / np.sqrt(runs))


def test_patterns_of_a_batch_are_those_of_its_runs(write, rng):
    """A table whose covariances differ from run to run: each run's draw is scaled by its own."""
    o = load_scenario(write()).stated
    factor = np.array([1.0, 3.0])
    batch = replace(
        o,
        cov_attitude_E=factor[:, None, None, None] ** 2 * o.cov_attitude_E,
        sigma_px=factor[:, None] * o.sigma_px,
    )
    for name, index in (("attitude", 0), ("pixel", 3)):
        whole, one = sources.stated_sources(batch)[index], sources.stated_sources(o)[index]
        assert whole.name == name
        xi = rng.standard_normal((2, one.groups, one.component.size))
        np.testing.assert_allclose(whole.error(xi), factor[:, None, None] * one.error(xi), rtol=1e-12)
