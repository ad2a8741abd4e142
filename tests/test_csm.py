"""Community sensor models: states and ISDs, against what the USGS models themselves answer.

The models of ``SCANNER`` and ``FRAMER`` are those of the tests of DOI-USGS/usgscsm (orbitalLineScan.json and
orbitalFramer.json: 50 km above a sphere of 1000 km, pixels of 100 m), enlarged 6.371 times to the Earth; the places
that those tests expect grow alike.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from starplumb.io.campaign.read import load_campaign
from starplumb.io.vendors.csm.product import read_csm
from starplumb.io.vendors.product import import_product
from starplumb.physics.camera import Distortion
from starplumb.physics.errors import InputError
from starplumb.physics.orientation import EarthOrientation
from starplumb.table.geometry import stations

GROWTH = 6.371
SCANNER = {
    "m_modelName": "USGS_ASTRO_LINE_SCANNER_SENSOR_MODEL",
    "m_nLines": 16,
    "m_nSamples": 16,
    "m_intTimeLines": [0.5],
    "m_intTimeStartTimes": [-0.85],
    "m_intTimes": [0.1],
    "m_centerEphemerisTime": 1000.0,
    "m_detectorSampleSumming": 1.0,
    "m_detectorLineSumming": 1.0,
    "m_startingDetectorSample": 0.0,
    "m_startingDetectorLine": 0.0,
    "m_focalLength": 50.0,
    "m_zDirection": 1.0,
    "m_distortionType": 0,
    "m_opticalDistCoeffs": [0.0, 0.0, 0.0],
    "m_iTransS": [0.0, 0.0, 10.0],
    "m_iTransL": [0.0, -10.0, 0.0],
    "m_detectorSampleOrigin": 8.0,
    "m_detectorLineOrigin": 0.0,
    "m_majorAxis": 1e6,
    "m_minorAxis": 1e6,
    "m_dtEphem": 0.1,
    "m_t0Ephem": -0.8,
    "m_dtQuat": 0.1,
    "m_t0Quat": -0.8,
}
"""The detector's line is at 0 here, as in the version of the model whose tests are quoted."""


def turned(k):
    """Orbit and attitude k milliradian-tenths along the circle, as the ISD tabulates them: 1e-4 rad a step."""
    angle = -1e-4 * np.asarray(k)
    r = 1.05e6 * np.stack([np.cos(angle), np.zeros(angle.shape), np.sin(angle)], axis=-1)
    v = -1.05e3 * np.stack([-np.sin(angle), np.zeros(angle.shape), np.cos(angle)], axis=-1)
    q = Rotation.from_euler("y", -90.0, degrees=True).as_quat()
    return (
        r,
        v,
        (
            Rotation.from_rotvec(np.stack([np.zeros(angle.shape), -angle, np.zeros(angle.shape)], axis=-1))
            * Rotation.from_quat(q)
        ).as_quat(),
    )


def scanner(tmp_path, header=True, name="image.json", **changes):
    """The file of a state, with the name of the model in a line before it or not."""
    r, v, q = turned(np.arange(16))
    state = SCANNER | {
        "m_positions": (GROWTH * r).ravel().tolist(),
        "m_velocities": (GROWTH * v).ravel().tolist(),
    }
    state |= {"m_quaternions": q.ravel().tolist(), "m_majorAxis": GROWTH * 1e6, "m_minorAxis": GROWTH * 1e6}
    text = json.dumps({key: value for key, value in (state | changes).items() if value is not None})
    (tmp_path / name).write_text((f"{SCANNER['m_modelName']}\n" if header else "") + text)
    return tmp_path / name


def ground(campaign, C_EK, column, row):
    """Where a pixel meets the sphere, by hand."""
    s = stations(campaign, np.array([0]), np.array([row]))
    xy, _ = campaign.camera.tan_from_px(np.array([column]), np.array([row]))
    u = s.C_EJ[0].T @ C_EK @ np.append(xy[0], 1.0)
    u, r = u / np.linalg.norm(u), s.r_J[0]
    b = u @ r
    return r - u * (b + np.sqrt(b**2 - r @ r + (GROWTH * 1e6) ** 2))


def test_the_scanner_sees_where_the_model_of_the_usgs_does(tmp_path):
    """Its tests: line 8.5, sample 8 is at (999999.680000017, 0, -799.99991466668735)."""
    for header in (True, False):
        product = read_csm(scanner(tmp_path, header))
        found = ground(product.campaign(1.0, 1.0), product.C_EK, 7.5, 8.0)
        expected = GROWTH * np.array([999999.680000017, 0.0, -799.99991466668735])
        np.testing.assert_allclose(found, expected, atol=1e-4)
    campaign = product.campaign(1.0, 1.0)
    # a sample is 100 m along y, and the Earth falls off by 0.03 m over it
    step = ground(campaign, product.C_EK, 8.5, 8.0) - ground(campaign, product.C_EK, 7.5, 8.0)
    np.testing.assert_allclose(np.abs(step), [0.0, GROWTH * 100.0, 0.0], atol=0.04)
    assert (product.columns, product.rows, product.frame) == (16, 16, "ITRF")
    assert product.notices == ()
    np.testing.assert_allclose(product.C_EK @ product.C_EK.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(product.C_EK) == pytest.approx(1.0)


def test_lines_of_other_durations_are_a_table_of_rows(tmp_path):
    """From line 10.5 on twice as long: the exposures of rows 0, 9, 10 and 15 by hand, the middle of each line."""
    path = scanner(
        tmp_path, m_intTimeLines=[0.5, 10.5], m_intTimeStartTimes=[-0.85, 0.15], m_intTimes=[0.1, 0.2]
    )
    product = read_csm(path)
    row = np.array([0.0, 9.0, 10.0, 15.0])
    exposed = product.campaign(1.0, 1.0).images.exposed(np.zeros(4, dtype=np.int64), row)
    # row 9 lies between row 0 and row 10, whose middles are 1.05 s apart
    np.testing.assert_allclose(1e-9 * (exposed - exposed[0]), [0.0, 0.945, 1.05, 2.05], atol=1e-6)


def test_a_file_without_a_day_is_told(tmp_path):
    product = read_csm(scanner(tmp_path, m_centerEphemerisTime=0.0))
    assert "states no day" in product.notices[0]
    found = ground(product.campaign(1.0, 1.0), product.C_EK, 7.5, 8.0)
    np.testing.assert_allclose(found[2], -GROWTH * 799.99991466668735, atol=1e-4)


def test_radial_distortion_is_taken_off_as_the_model_does(tmp_path):
    """u = d - d (k0 + k1 r^2): at sample 12.5 d is 0.45 mm, so u = 0.45 (1 - 0.01 - 0.02 * 0.2025) = 0.4436775 mm."""
    product = read_csm(scanner(tmp_path, m_opticalDistCoeffs=[0.01, 0.02, 0.0]))
    xy, _ = product.campaign(1.0, 1.0).camera.tan_from_px(np.array([12.0]), np.array([0.0]))
    np.testing.assert_allclose(np.linalg.norm(xy[0]), 0.4436775 / 50.0, rtol=1e-12)


FRAMER = {
    "name_model": "USGS_ASTRO_FRAME_SENSOR_MODEL",
    "center_ephemeris_time": 50.0,
    "detector_sample_summing": 1,
    "detector_line_summing": 1,
    "focal2pixel_lines": [0.0, 10.0, 0.0],
    "focal2pixel_samples": [0.0, 0.0, 10.0],
    "focal_length_model": {"focal_length": 50},
    "image_lines": 16,
    "image_samples": 16,
    "detector_center": {"line": 8.0, "sample": 8.0},
    "optical_distortion": {"radial": {"coefficients": [0.0, 0.0, 0.0]}},
    "radii": {"semimajor": GROWTH * 1000, "semiminor": GROWTH * 1000, "unit": "km"},
    "instrument_position": {
        "positions": [[GROWTH * 1050.0, 0.0, 0.0]],
        "velocities": [[0.0, 0.0, -1.0]],
        "ephemeris_times": [50],
        "reference_frame": 1,
    },
    "instrument_pointing": {
        "quaternions": [[-0.7071067811865476, 0.0, -0.7071067811865476, 0]],
        "angular_velocities": [[0, 0, 0]],
        "ephemeris_times": [50],
        "reference_frame": 1,
    },
    "starting_detector_line": 0,
    "starting_detector_sample": 0,
}


def framer(tmp_path, **changes):
    (tmp_path / "frame.json").write_text(json.dumps(FRAMER | changes))
    return tmp_path / "frame.json"


def test_the_frame_sees_where_the_model_of_the_usgs_does(tmp_path):
    """Its tests: line 8, sample 8 is at (1e6, 0, 0), pixels are 100 m, lines go along z, samples along y; in J2000."""
    with pytest.raises(InputError, match="found an image that is mirrored"):
        read_csm(framer(tmp_path))
    flipped = framer(tmp_path, focal2pixel_lines=[0.0, -10.0, 0.0])
    product = read_csm(flipped)
    campaign = product.campaign(1.0, 1.0)
    C_IJ = EarthOrientation.load().C_IJ(campaign.images.t_ns)[0]
    center = C_IJ @ ground(campaign, product.C_EK, 7.5, 7.5)
    np.testing.assert_allclose(center, [GROWTH * 1e6, 0.0, 0.0], atol=1e-3)
    across = C_IJ @ ground(campaign, product.C_EK, 8.5, 7.5) - center
    np.testing.assert_allclose(across[1], GROWTH * 100.0, rtol=1e-5)
    down = C_IJ @ ground(campaign, product.C_EK, 7.5, 8.5) - center
    np.testing.assert_allclose(np.abs(down[2]), GROWTH * 100.0, rtol=1e-5)


def test_a_constant_rotation_stands_behind_the_varying_one(tmp_path):
    """Turning the instrument by A and the camera back by the constant inverse changes nothing."""
    turn = Rotation.from_rotvec([0.1, -0.4, 0.2])
    first = Rotation.from_quat([0.0, -0.7071067811865476, 0.0, -0.7071067811865476])
    pointing = FRAMER["instrument_pointing"] | {
        "quaternions": np.roll((turn * first).as_quat(), 1)[None].tolist(),
        "constant_rotation": turn.inv().as_matrix().ravel().tolist(),
    }
    plain = read_csm(framer(tmp_path, focal2pixel_lines=[0.0, -10.0, 0.0]))
    moved = read_csm(framer(tmp_path, focal2pixel_lines=[0.0, -10.0, 0.0], instrument_pointing=pointing))
    C, D = (Rotation.from_quat(product.q_EF).as_matrix() for product in (plain, moved))
    np.testing.assert_allclose(D, C, atol=1e-12)


def test_a_radial_tangential_lens_turns_with_the_axes(tmp_path):
    """A pixel's look direction in the camera's own axes is that of the formula in those axes."""
    c = [0.02, -0.01, 0.003, -0.002, 0.001]
    lens = {"radtan": {"coefficients": c}}
    product = read_csm(framer(tmp_path, focal2pixel_lines=[0.0, -10.0, 0.0], optical_distortion=lens))
    campaign = product.campaign(1.0, 1.0)
    xy, _ = campaign.camera.tan_from_px(np.array([12.0]), np.array([3.0]))
    seen = product.C_EK @ np.append(xy[0], 1.0)
    # line 3.5, sample 12.5: x = -(3.5 - 8) / 10, y = (12.5 - 8) / 10 mm, and the lens gives these from the ideal ones
    distorted = np.array([0.45, 0.45]) / 50.0
    k1, k2, p1, p2, k3 = c
    np.testing.assert_allclose(
        Distortion((k1, k2, k3), (p1, p2)).apply(seen[:2] / seen[2])[0], distorted, atol=1e-14
    )


def test_import_makes_a_campaign_of_a_state(tmp_path):
    path = scanner(
        tmp_path, m_intTimeLines=[0.5, 10.5], m_intTimeStartTimes=[-0.85, 0.15], m_intTimes=[0.1, 0.11]
    )
    with pytest.raises(InputError, match="wanted sigma_m and sigma_arcsec stated"):
        import_product(path, tmp_path / "none")
    (tmp_path / "landmarks.csv").write_text(
        "landmark_id,latitude_deg,longitude_deg,height_m,sigma_m\na,0,0,0,1\n"
    )
    (tmp_path / "seen.csv").write_text("image_id,landmark_id,column_px,row_px,sigma_px\nimage,a,7.5,8,1\n")
    tables = {"landmarks": tmp_path / "landmarks.csv", "observations": tmp_path / "seen.csv"}
    import_product(path, tmp_path / "out", sigma_m=3.0, sigma_arcsec=5.0, **tables)
    loaded = load_campaign(tmp_path / "out" / "campaign.toml").campaign
    assert loaded.images.row_times is not None
    assert not loaded.corrections.aberration
    found = ground(loaded, loaded.C_EK, 7.5, 8.0)
    np.testing.assert_allclose(found[0], GROWTH * 999999.68, atol=0.1)


FAULTS = {
    "another planet": ({"m_majorAxis": 3.4e6}, "found an ellipsoid of 3400 and 6371 km, wanted the Earth's"),
    "a key less": ({"m_focalLength": None}, "found no m_focalLength, wanted it"),
    "another lens": ({"m_distortionType": 2}, "m_distortionType: found 2, wanted 0 (radial) or 7"),
    "an adjusted model": ({"m_currentParameterValue": [0.0, 1.0]}, "wanted zeros: an unadjusted model"),
    "three lists of quaternions": ({"m_quaternions": [0.0, 0.0, 1.0]}, "m_quaternions: found"),
    "long quaternions": (
        {"m_quaternions": [0.0, 0.0, 0.0, 2.0] * 16},
        "m_quaternions: found 2.0, wanted quaternions",
    ),
    "a text": ({"m_nLines": "16"}, 'm_nLines: found "16", wanted a finite number'),
    "half a line": ({"m_nLines": 16.5}, "m_nLines: found 16.5, wanted a positive whole number"),
    "no step": ({"m_dtEphem": 0.0}, "m_dtEphem: found 0.0, wanted a positive number of seconds"),
    "times of other lines": ({"m_intTimes": [0.1, 0.1]}, "m_intTimes: found"),
    "no depth": ({"m_focalLength": 0.0}, "found a focal length of 0 mm and the transformations"),
    "a flat plane": (
        {"m_iTransS": [0.0, 10.0, 0.0], "m_iTransL": [0.0, 10.0, 0.0]},
        "wanted those from the focal",
    ),
    "turning back": (
        {"m_intTimeLines": [0.5, 10.5], "m_intTimeStartTimes": [-0.85, -0.9], "m_intTimes": [0.1, 0.1]},
        "found times of lines that turn back",
    ),
}


@pytest.mark.parametrize("case", FAULTS)
def test_what_cannot_be_used_is_said_in_one_line(tmp_path, case):
    changes, message = FAULTS[case]
    with pytest.raises(InputError, match=r"image\.json") as error:
        read_csm(scanner(tmp_path, **changes))
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_other_models_and_frames_are_refused(tmp_path):
    (tmp_path / "sar.json").write_text('USGS_ASTRO_SAR_SENSOR_MODEL\n{"a": 1}')
    with pytest.raises(InputError, match='found the sensor model "USGS_ASTRO_SAR_SENSOR_MODEL"'):
        read_csm(tmp_path / "sar.json")
    (tmp_path / "bad.json").write_text("USGS_ASTRO_FRAME_SENSOR_MODEL\n{")
    with pytest.raises(InputError, match=r"bad\.json: found text that is not JSON"):
        read_csm(tmp_path / "bad.json")
    for changes, message in (
        ({"focal2pixel_samples": [0.0, 0.0, 11.0], "focal2pixel_lines": [0.0, -10.0, 0.0]}, "not square"),
        ({"starting_detector_line": 4}, "wanted the whole detector"),
        ({"optical_distortion": {"cahvor": {"coefficients": []}}}, "wanted radial or radtan"),
        ({"name_model": "USGS_ASTRO_PUSH_FRAME_SENSOR_MODEL"}, "name_model: found"),
    ):
        with pytest.raises(InputError, match=message):
            read_csm(framer(tmp_path, **changes))


def test_a_frame_state_becomes_a_campaign_of_one_sample(tmp_path):
    """Orbit and attitude are there at the exposure only, and nowhere else needed."""
    state = {
        "m_modelName": "USGS_ASTRO_FRAME_SENSOR_MODEL",
        "m_currentParameterValue": [
            GROWTH * 1.05e6,
            0.0,
            0.0,
            0.0,
            -0.7071067811865476,
            0.0,
            0.7071067811865476,
        ],
        "m_spacecraftVelocity": [0.0, 0.0, -7000.0],
        "m_ephemerisTime": 650000000.0,
        "m_focalLength": 50.0,
        "m_iTransL": [0.0, -10.0, 0.0],
        "m_iTransS": [0.0, 0.0, 10.0],
        "m_ccdCenter": [8.0, 8.0],
        "m_opticalDistCoeffs": [0.0, 0.0, 0.0],
        "m_nLines": 16,
        "m_nSamples": 16,
        "m_majorAxis": 6378137.0,
        "m_minorAxis": 6356752.3,
    }
    (tmp_path / "image.json").write_text(json.dumps(state))
    (tmp_path / "landmarks.csv").write_text(
        "landmark_id,latitude_deg,longitude_deg,height_m,sigma_m\na,0,0,0,1\n"
    )
    (tmp_path / "seen.csv").write_text("image_id,landmark_id,column_px,row_px,sigma_px\nimage,a,7.5,7.5,1\n")
    tables = {"landmarks": tmp_path / "landmarks.csv", "observations": tmp_path / "seen.csv"}
    import_product(tmp_path / "image.json", tmp_path / "out", sigma_m=3.0, sigma_arcsec=5.0, **tables)
    loaded = load_campaign(tmp_path / "out" / "campaign.toml").campaign
    np.testing.assert_allclose(ground(loaded, loaded.C_EK, 7.5, 7.5), [GROWTH * 1e6, 0.0, 0.0], atol=1e-6)
