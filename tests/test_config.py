"""A campaign's declarations brought inside: mountings, frames, directions, units, origins, and the way back to disk."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import erfa
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bad_cases import AEM, DETECTORS, LINE_SCAN, NO_OPTICS, OEM, both, put, swap
from helpers import CAMPAIGN, FILES, OBSERVATIONS, write_good_campaign
from starplumb.io.campaign.read import LoadedCampaign, load_campaign
from starplumb.io.campaign.write import write_campaign
from starplumb.physics.earth import C_JT, geodetic_to_itrf
from starplumb.physics.errors import EpochError, InputError
from starplumb.physics.units import ARCSEC
from starplumb.table.campaign import Campaign, Images, Landmarks
from starplumb.table.geometry import position_covariance

TOML, IDENTITY = "campaign.toml", "quaternion_xyzw = [0.0, 0.0, 0.0, 1.0]"
GM, OMEGA = 3.986004418e14, 7.292115e-5


def load(folder: Path, *changes: tuple[str, str, str], with_detections: bool = False) -> LoadedCampaign:
    """The good campaign, with texts exchanged."""
    path = write_good_campaign(folder)
    for change in changes:
        swap(*change, -1)(folder)
    return load_campaign(path, with_detections=with_detections)


TURN = Rotation.from_euler("ZYX", [100.0, -20.0, 3.0], degrees=True)
XYZW = TURN.as_quat().tolist()


@pytest.mark.parametrize(
    "written",
    [
        f"quaternion_xyzw = {XYZW}",
        f"quaternion_xyzw = {[-1.0005 * q for q in XYZW]}",
        f"quaternion_wxyz = {XYZW[3:] + XYZW[:3]}",
        f"matrix = {TURN.as_matrix().tolist()}",
        f"rotation_vector_deg = {np.rad2deg(TURN.as_rotvec()).tolist()}",
        'euler_deg = [100.0, -20, 3]\neuler_order = "ZYX"',
        'euler_deg = [3.0, -20.0, 100.0]\neuler_order = "xyz"',
        f'euler_deg = {TURN.as_euler("zxz", degrees=True).tolist()}\neuler_order = "zxz"',
    ],
    ids=["xyzw", "xyzw-scaled", "wxyz", "matrix", "vector", "euler-turned", "euler-fixed", "euler-proper"],
)
@pytest.mark.parametrize("inverse", [False, True], ids=["camera-to-tracker", "tracker-to-camera"])
def test_every_way_to_write_a_mounting(tmp_path: Path, written: str, inverse: bool) -> None:
    changes = [(TOML, IDENTITY, written)]
    if inverse:
        changes.append((TOML, 'from = "camera"\nto = "star_tracker"', 'from = "star_tracker"\nto = "camera"'))
    expected = TURN.inv() if inverse else TURN
    np.testing.assert_allclose(load(tmp_path, *changes).campaign.C_EK, expected.as_matrix(), atol=1e-14)


def test_rounded_matrix_is_made_a_rotation_and_told(tmp_path: Path) -> None:
    loaded = load(tmp_path, (TOML, IDENTITY, f"matrix = {TURN.as_matrix().round(4).tolist()}"))
    C = loaded.campaign.C_EK
    np.testing.assert_allclose(C @ C.mT, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(C, TURN.as_matrix(), atol=1e-4)
    assert ["mounting.matrix" in notice for notice in loaded.notices] == [True]


def test_names_of_the_tracker_are_the_users(tmp_path: Path) -> None:
    loaded = load(tmp_path, (TOML, '"star_tracker"', '"STR-A"'))
    assert loaded.config.tracker == "STR-A"


def test_units_at_the_edge(tmp_path: Path) -> None:
    prior = (TOML, IDENTITY, IDENTITY + "\nsigma_arcsec = 3600")
    campaign = load(tmp_path, prior).campaign
    camera = campaign.camera
    assert (camera.focal_length, camera.pitch) == pytest.approx((2.2, 9e-6), rel=1e-15)
    np.testing.assert_allclose(campaign.cov_attitude_E, np.diag([25.0, 25.0, 144.0]) * (np.pi / 648000) ** 2)
    np.testing.assert_allclose(campaign.sigma_mounting, np.full(3, np.pi / 180))
    np.testing.assert_array_equal(campaign.sigma_position, [3.0, 3.0, 3.0])
    # I1 is 1.5 s after midnight UTC; TAI - UTC is 37 s in 2020, and 2000-01-01T12 TAI lies 7304.5 days before
    assert campaign.images.t_ns[0] == round((7304.5 * 86400 + 37 + 1.5) * 1e9)


def test_landmarks_by_hand(tmp_path: Path) -> None:
    sigmas = "landmark_id,latitude_deg,longitude_deg,height_m,sigma_east_m,sigma_north_m,sigma_up_m\n"
    rows = "A,0,0,100,1,2,3\nB,0,90,0,1,2,3\nC,90,0,0,1,2,3\n"
    path = write_good_campaign(
        tmp_path,
        landmarks=sigmas + rows,
        observations="image_id,landmark_id,column_px,row_px,sigma_px\nI1,A,1,1,1\n",
    )
    loaded = load_campaign(path)
    landmarks = loaded.campaign.landmarks
    # on the equator at 0 E: up is x, east is y, north is z; at 90 E: up is y, east is -x; at the pole: up is z, east y
    b = 6356752.314245179
    np.testing.assert_allclose(landmarks.r_J, [[6378237.0, 0, 0], [0, 6378137.0, 0], [0, 0, b]], atol=1e-8)
    expected = [np.diag([9.0, 1.0, 4.0]), np.diag([1.0, 9.0, 4.0]), np.diag([4.0, 1.0, 9.0])]
    np.testing.assert_allclose(landmarks.covariance_J, expected, atol=1e-12)
    assert [notice.split("found ")[1] for notice in loaded.notices] == [
        "no row of the image I2, so it adds nothing",
        "no row of the landmarks B, C, so it adds nothing",
    ]


def test_cartesian_landmarks_are_the_same_places(tmp_path: Path) -> None:
    geodetic = load(tmp_path / "a").campaign.landmarks
    rows = [f"L{i},{x!r},{y!r},{z!r},0.5" for i, (x, y, z) in enumerate(geodetic.r_J.tolist(), 1)]
    table = "\n".join(["landmark_id,x_m,y_m,z_m,sigma_m", *rows])
    cartesian = load_campaign(write_good_campaign(tmp_path / "b", landmarks=table)).campaign.landmarks
    np.testing.assert_array_equal(cartesian.r_J, geodetic.r_J)
    np.testing.assert_allclose(cartesian.covariance_J, geodetic.covariance_J, atol=1e-14)


def test_attitude_in_either_direction(tmp_path: Path) -> None:
    there = load(tmp_path / "a").campaign
    back = load(
        tmp_path / "b",
        (TOML, 'from = "ITRF"\nto = "star_tracker"', 'from = "star_tracker"\nto = "ITRF"'),
        ("attitude.csv", "0.5,0.5,-0.5,0.5", "-0.5,-0.5,0.5,0.5"),
    ).campaign
    for campaign in (there, back):
        C_EJ, _ = campaign.attitude.at(campaign.images.t_ns)
        np.testing.assert_allclose(C_EJ[0], [[0, 1, 0], [0, 0, -1], [-1, 0, 0]], atol=1e-15)


def test_messages_give_what_the_tables_give(tmp_path: Path) -> None:
    tables = load(tmp_path / "a").campaign
    path = write_good_campaign(tmp_path / "b")
    both(
        swap(TOML, "ephemeris.csv", "orbit.oem"),
        swap(TOML, "attitude.csv", "attitude.aem"),
        put("orbit.oem", OEM),
        put("attitude.aem", AEM),
    )(tmp_path / "b")
    loaded = load_campaign(path)
    t_ns = tables.images.t_ns
    np.testing.assert_allclose(loaded.campaign.attitude.at(t_ns)[0], tables.attitude.at(t_ns)[0], atol=1e-15)
    np.testing.assert_allclose(loaded.campaign.ephemeris.at(t_ns)[0], tables.ephemeris.at(t_ns)[0], atol=1e-6)
    assert [notice.split(": ")[1] for notice in loaded.notices] == [
        "took its frame STR_1 for star_tracker, the name in the campaign"
    ]


def test_arcs_of_a_message_are_not_joined(tmp_path: Path) -> None:
    """Two segments whose samples follow one another by the usual step, as after a manoeuvre."""
    head, _ = OEM.split("META_STOP\n")
    row = "2020-01-01T00:00:0{} 7058.137 0.0 {} 0.0 0.0 7.5\n"
    samples = [row.format(i, -15.0 + 7.5 * i) for i in range(5)]
    meta = "META_START" + head.split("META_START")[1] + "META_STOP\n"
    path = write_good_campaign(tmp_path, campaign=CAMPAIGN.replace("ephemeris.csv", "orbit.oem"))
    for cut, fine in (
        (2, False),
        (3, True),
    ):  # I1 at 1.5 s and I2 at 2.5 s: the second cut is between 2 s and 3 s
        text = head + "META_STOP\n" + "".join(samples[:cut]) + meta + "".join(samples[cut:])
        (tmp_path / "orbit.oem").write_text(text)
        ephemeris = load_campaign(path).campaign.ephemeris
        at = load_campaign(path).campaign.images.t_ns[:1]
        if fine:
            ephemeris.at(at)
        else:
            with pytest.raises(
                EpochError, match=r"orbit\.oem \(samples more than .* or of two arcs are not joined\)"
            ):
                ephemeris.at(at)


def C_JF(word: str, seconds: float) -> np.ndarray:
    """ITRF from an inertial frame, by ERFA's own series, so many seconds into 2020."""
    # 2020-01-01 UTC: TT - UTC = 69.184 s; UT1 - UTC = -0.17713 s, pole (0.0766, 0.2827) arcsec by IERS Bulletin B
    tt = 2458849.5, (69.184 + seconds) / 86400
    ut1 = 2458849.5, (-0.17713 + seconds) / 86400
    pole = 0.0766 * ARCSEC, 0.2827 * ARCSEC
    C_JI = erfa.c2t06a(*tt, *ut1, *pole)
    match word:
        case "TEME":  # Vallado, AIAA 2006-6753: the sidereal time of 1982 takes it into the Earth
            return erfa.pom00(*pole, erfa.sp00(*tt)) @ erfa.rz(erfa.gmst82(*ut1), np.eye(3))
        case "TOD":
            return C_JI @ erfa.pnm06a(*tt).T
        case "MOD":
            return C_JI @ erfa.pmat06(*tt).T
    return C_JI


@pytest.mark.parametrize("word", ["GCRF", "J2000", "EME2000", "ICRF", "TEME", "TOD", "MOD"])
def test_inertial_orbit_is_turned_at_its_own_epochs(tmp_path: Path, word: str) -> None:
    """A circular orbit by hand in an inertial frame; r_J by ERFA's own series, v_J by differences of it."""
    radius = 7.0e6
    rate = np.sqrt(GM / radius**3)

    def state(seconds: float) -> tuple[np.ndarray, np.ndarray]:
        c, s = np.cos(rate * seconds), np.sin(rate * seconds)
        return radius * np.array([c, 0.6 * s, 0.8 * s]), radius * rate * np.array([-s, 0.6 * c, 0.8 * c])

    def r_J(seconds: float) -> np.ndarray:
        return np.asarray(C_JF(word, seconds) @ state(seconds)[0])

    rows = [
        f"2020-01-01T00:00:{10 * i:02d}," + ",".join(map(repr, np.concatenate(state(10.0 * i)).tolist()))
        for i in range(5)
    ]
    table = "\n".join(["time,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s", *rows])
    path = write_good_campaign(
        tmp_path, ephemeris=table, campaign=CAMPAIGN.replace('frame = "ITRF"', f'frame = "{word}"')
    )
    loaded = load_campaign(path)
    campaign = loaded.campaign
    assert campaign.position_frame == (word if word in ("TEME", "TOD", "MOD") else "GCRF")
    assert not loaded.predicted_orientation
    r, v = campaign.ephemeris.at(campaign.images.t_ns[:1] + 10**10)  # 11.5 s
    np.testing.assert_allclose(r[0], r_J(11.5), atol=0.05)  # 1 mas at 7000 km is 3 cm
    np.testing.assert_allclose(v[0], (r_J(12.5) - r_J(10.5)) / 2.0, atol=0.01)


@pytest.mark.parametrize("word", ["EME2000", "TEME", "TOD", "MOD"])
@pytest.mark.parametrize("reverse", [False, True], ids=["to tracker", "from tracker"])
def test_an_attitude_in_an_inertial_frame_is_that_in_the_earths(
    tmp_path: Path, word: str, reverse: bool
) -> None:
    """The attitude of the campaign by hand, C_EJ at rest, written as C_EJ C_JF with ERFA's C_JF."""
    C_EJ = Rotation.from_quat([0.5, 0.5, -0.5, 0.5]).as_matrix()
    turns = [Rotation.from_matrix(C_EJ @ C_JF(word, s)) for s in range(5)]
    rows = [
        f"2020-01-01T00:00:0{s}.000," + ",".join(map(repr, (t.inv() if reverse else t).as_quat().tolist()))
        for s, t in enumerate(turns)
    ]
    ends = f'from = "star_tracker"\nto = "{word}"' if reverse else f'from = "{word}"\nto = "star_tracker"'
    toml = CAMPAIGN.replace('from = "ITRF"\nto = "star_tracker"', ends)
    table = "\n".join(["time,qx,qy,qz,qw", *rows])
    loaded = load_campaign(write_good_campaign(tmp_path, attitude=table, campaign=toml))
    found, omega_E = loaded.campaign.attitude.at(loaded.campaign.images.t_ns)
    off = Rotation.from_matrix(found @ C_EJ.T).as_rotvec() / ARCSEC
    assert np.max(np.abs(off)) < 2e-3
    assert np.max(np.abs(omega_E)) < 1e-9


def test_sigmas_of_positions_are_along_the_axes_of_their_frame(tmp_path: Path) -> None:
    """One sigma of a kilometre: precession since 2000 turns 1.9 m of it into the plane across."""
    for name in ("GCRF", "TEME"):
        stated = f'frame = "{name}"\nsigma_m = [1.0, 1.0, 1000.0]'
        campaign = load(tmp_path / name, (TOML, 'frame = "ITRF"\nsigma_m = 3.0', stated)).campaign
        C = C_JF(name, 1.5)
        np.testing.assert_allclose(
            position_covariance(campaign)[0], C @ np.diag([1.0, 1.0, 1e6]) @ C.T, atol=0.05
        )


def test_a_campaign_in_a_frame_of_date_is_written_and_read_again(tmp_path: Path) -> None:
    campaign = load(tmp_path / "a", (TOML, 'frame = "ITRF"', 'frame = "TEME"')).campaign
    again = load_campaign(write_campaign(tmp_path / "b", campaign)).campaign
    assert again.position_frame == "TEME"
    assert_same(again, campaign)


def test_sigmas_of_the_attitude_table(tmp_path: Path) -> None:
    table = (
        "time,qx,qy,qz,qw,sigma_x_arcsec,sigma_y_arcsec,sigma_z_arcsec\n"
        "2020-01-01T00:00:01.000,0.5,0.5,-0.5,0.5,4,5,10\n"
        "2020-01-01T00:00:03.000,0.5,0.5,-0.5,0.5,8,5,30\n"
    )
    loaded = load_campaign(write_good_campaign(tmp_path, attitude=table))
    # I1 lies a quarter of the way from the first sample to the second, I2 three quarters
    stated = loaded.campaign.cov_attitude_E / ARCSEC**2
    np.testing.assert_allclose(stated, [np.diag([25.0, 25.0, 225.0]), np.diag([49.0, 25.0, 625.0])])
    assert ["attitude.sigma_arcsec is not used" in notice for notice in loaded.notices] == [True]


def test_pixel_origin_moves_everything_by_half_a_pixel(tmp_path: Path) -> None:
    centre = load(tmp_path / "a").campaign
    loaded = load(tmp_path / "b", (TOML, "[mounting]", 'pixel_origin = "corner"\n[mounting]'))
    corner = loaded.campaign
    np.testing.assert_array_equal(corner.sightings.column_px, centre.sightings.column_px - 0.5)
    np.testing.assert_array_equal(corner.sightings.row_px, centre.sightings.row_px - 0.5)
    assert corner.camera.principal_point_px == (5999.0, 5999.0)
    assert loaded.shift_px == 0.5


def test_line_scanner_by_table(tmp_path: Path) -> None:
    path = write_good_campaign(tmp_path)
    images = "image_id,time,line_period_s\nI1,2020-01-01T00:00:01.5,1e-4\nI2,2020-01-01T00:00:02.5,1e-4\n"
    both(LINE_SCAN, NO_OPTICS, put("detectors.csv", DETECTORS), put("images.csv", images))(tmp_path)
    camera = load_campaign(path).campaign.camera
    assert camera.size_px == (12000.0, np.inf)
    xy_K, _ = camera.tan_from_px([0.0, 2999.5, 8999.0], 0.0)
    np.testing.assert_allclose(xy_K, [[-0.02, 0.001], [-0.01, 0.001], [0.01, 0.001]], atol=1e-15)


def test_detectors_are_counted_as_pixels_are(tmp_path: Path) -> None:
    path = write_good_campaign(tmp_path)
    images = "image_id,time,line_period_s\nI1,2020-01-01T00:00:01.5,1e-4\nI2,2020-01-01T00:00:02.5,1e-4\n"
    detectors = "column_px,tan_x,tan_y\n0.5,-0.02,0\n11999.5,0.02,0\n"
    both(LINE_SCAN, NO_OPTICS, put("detectors.csv", detectors), put("images.csv", images))(tmp_path)
    swap(TOML, "[mounting]", 'pixel_origin = "corner"\n[mounting]')(tmp_path)
    camera = load_campaign(path).campaign.camera
    xy_K, _ = camera.tan_from_px([0.0, 11999.0], 0.0)
    np.testing.assert_allclose(xy_K[:, 0], [-0.02, 0.02], atol=1e-15)
    assert camera.size_px[0] == 12000.0


def test_line_scanner_by_optics(tmp_path: Path) -> None:
    path = write_good_campaign(tmp_path)
    images = "image_id,time,line_period_s\nI1,2020-01-01T00:00:01.5,1e-4\nI2,2020-01-01T00:00:02.5,1e-4\n"
    both(LINE_SCAN, swap(TOML, "[5999.5, 5999.5]", "[5999.5, -40.0]"), put("images.csv", images))(tmp_path)
    camera = load_campaign(path).campaign.camera
    xy_K, _ = camera.tan_from_px([5999.5, 6999.5], 0.0)
    scale = 9e-6 / 2.2
    np.testing.assert_allclose(xy_K, [[0.0, -40 * scale], [1000 * scale, -40 * scale]], atol=1e-15)


def test_missing_switches_have_the_documented_values(tmp_path: Path) -> None:
    corrections = load(tmp_path / "a").campaign.corrections
    assert (corrections.light_time, corrections.aberration, corrections.refraction) == (True, True, False)
    switched = load(
        tmp_path / "b", (TOML, "[images]", "[corrections]\naberration = false\nrefraction = true\n[images]")
    )
    corrections = switched.campaign.corrections
    assert (corrections.light_time, corrections.aberration, corrections.refraction) == (True, False, True)


@pytest.mark.parametrize("form", ["bom", "crlf"])
def test_toml_from_other_editors(tmp_path: Path, form: str) -> None:
    path = write_good_campaign(tmp_path)
    path.write_bytes(
        b"\xef\xbb\xbf" + path.read_bytes() if form == "bom" else path.read_bytes().replace(b"\n", b"\r\n")
    )
    assert load_campaign(path).campaign.name == "by hand"


def test_inputs_are_hashed(tmp_path: Path) -> None:
    loaded = load(tmp_path)
    assert loaded.inputs == {
        name: "sha256:" + hashlib.sha256(text.encode()).hexdigest() for name, text in FILES.items()
    }


def test_detections_for_a_caller_that_can_label_them(tmp_path: Path) -> None:
    detections = "image_id,column_px,row_px,sigma_px\nI2,10,20,0.5\nI1,30,40,0.25\n"
    path = write_good_campaign(
        tmp_path, campaign=CAMPAIGN.replace("[observations]", "[detections]"), observations=detections
    )
    loaded = load_campaign(path, with_detections=True)
    assert loaded.campaign.sightings.image.size == 0
    assert loaded.detections is not None
    assert loaded.detections.image.tolist() == [1, 0]
    assert loaded.detections.sigma_px.tolist() == [0.5, 0.25]


def test_notices_of_a_frame_camera_and_roles(tmp_path: Path) -> None:
    images = "image_id,time,line_period_s,cloud\nI1,2020-01-01T00:00:01.5,1e-4,0\nI2,2020-01-01T00:00:02.5,1e-4,0\n"
    roles = (
        OBSERVATIONS.replace("sigma_px", "sigma_px,role")
        .replace(",0.2\n", ",0.2,control\n")
        .replace("control", "check", 1)
    )
    loaded = load_campaign(write_good_campaign(tmp_path, images=images, observations=roles))
    assert loaded.campaign.sightings.check.tolist() == [True, False, False, False, False]
    assert [notice.split(": ")[1] for notice in loaded.notices] == [
        "ignored the column cloud",
        "ignored the column line_period_s, which a frame camera does not have",
    ]


def test_campaign_checks_its_own_shapes(tmp_path: Path) -> None:
    campaign = load(tmp_path).campaign
    with pytest.raises(ValueError, match="C_EK has shape"):
        replace(campaign, C_EK=np.eye(4))
    with pytest.raises(ValueError, match="image index"):
        replace(campaign, images=Images(("I1",), campaign.images.t_ns[:1]))
    with pytest.raises(ValueError, match="orientation"):
        replace(campaign, position_frame="GCRF")
    with pytest.raises(ValueError, match="ids repeat"):
        Images(("I1", "I1"), campaign.images.t_ns)


def surveyed() -> Landmarks:
    """Three landmarks far apart whose sigmas differ to the east, to the north and upwards."""
    ups = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.48, -0.64, -0.6]])
    easts = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.8, -0.6, 0.0]])
    # the point of an ellipsoid with semi-axes a whose normal is n lies at a^2 n / |a n|
    axes2 = np.array([6378137.0, 6378137.0, 6378137.0 * (1 - 1 / 298.257223563)]) ** 2
    r_J = ups * axes2 / np.sqrt(np.sum(ups**2 * axes2, axis=-1, keepdims=True)) + 123.0 * ups
    C_JT = np.stack([easts, np.cross(ups, easts), ups], axis=-1)
    return Landmarks(("L1", "L2", "L3"), r_J, C_JT @ np.diag([0.25, 1.0, 9.0]) @ C_JT.mT)


def assert_same(a: Campaign, b: Campaign) -> None:
    """Bit for bit, but for what turns through angles or frames."""
    for x, y in (
        (a.ephemeris.t_ns, b.ephemeris.t_ns),
        (a.attitude.t_ns, b.attitude.t_ns),
        (a.images.t_ns, b.images.t_ns),
        (a.sigma_position, b.sigma_position),
        (a.sightings.column_px, b.sightings.column_px),
        (a.sightings.row_px, b.sightings.row_px),
        (a.sightings.check, b.sightings.check),
    ):
        np.testing.assert_array_equal(x, y)
    np.testing.assert_allclose(a.C_EK, b.C_EK, atol=1e-15)
    np.testing.assert_allclose(a.attitude.q_EF, b.attitude.q_EF, atol=1e-15)
    np.testing.assert_allclose(a.cov_attitude_E, b.cov_attitude_E, rtol=1e-15)
    np.testing.assert_allclose(a.ephemeris.r_J, b.ephemeris.r_J, atol=1e-8)
    np.testing.assert_allclose(a.ephemeris.v_J, b.ephemeris.v_J, atol=1e-11)
    np.testing.assert_allclose(a.landmarks.r_J, b.landmarks.r_J, atol=1e-8)
    np.testing.assert_allclose(a.landmarks.covariance_J, b.landmarks.covariance_J, rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize("scale", ["UTC", "TAI", "GPS", "TT"])
@pytest.mark.parametrize("frame", ["ITRF", "GCRF"])
def test_written_campaign_reads_back(tmp_path: Path, scale: str, frame: str) -> None:
    campaign = load(tmp_path / "a", (TOML, 'frame = "ITRF"', f'frame = "{frame}"')).campaign
    campaign = replace(
        campaign,
        sigma_position=np.array([1.0, 2.0, 3.0]),
        images=replace(campaign.images, t_ns=campaign.images.t_ns + np.array([1, -1])),
        landmarks=surveyed(),
    )
    path = write_campaign(
        tmp_path / "b", campaign, time_scale=scale, comment="two\nlines", C_EK_true=TURN.as_matrix()
    )
    loaded = load_campaign(path)
    assert_same(loaded.campaign, campaign)
    assert loaded.campaign.camera == campaign.camera
    assert loaded.notices == ()
    assert loaded.C_EK_true is not None
    np.testing.assert_allclose(loaded.C_EK_true, TURN.as_matrix(), atol=1e-15)
    assert path.read_text().startswith("# two\n# lines\n\n[campaign]\n")


def test_written_line_scanner_reads_back(tmp_path: Path) -> None:
    path = write_good_campaign(tmp_path / "a")
    images = "image_id,time,line_period_s\nI1,2020-01-01T00:00:01.5,1.0000000001e-4\nI2,2020-01-01T00:00:02.5,1e-4\n"
    both(LINE_SCAN, NO_OPTICS, put("detectors.csv", DETECTORS), put("images.csv", images))(tmp_path / "a")
    campaign = load_campaign(path).campaign
    read = load_campaign(write_campaign(tmp_path / "b", campaign)).campaign
    assert_same(read, campaign)
    np.testing.assert_array_equal(read.camera.tan_x, campaign.camera.tan_x)
    np.testing.assert_array_equal(read.images.line_period_s, campaign.images.line_period_s)


@pytest.mark.parametrize("latitude_deg", [0.0, 60.0, 89.9, -89.999])
def test_a_survey_with_errors_of_metres_is_written_with_its_sigmas(
    tmp_path: Path, latitude_deg: float
) -> None:
    """Near a pole east turns by a degree over 200 m; what is stated is east, north and up of the place as surveyed."""
    campaign = load(tmp_path / "a").campaign
    latitude, longitude = np.radians(latitude_deg), np.radians([10.0, 100.0, -80.0])
    C = C_JT(latitude, longitude)
    sigma = np.array([1.0, 2.0, 5.0])
    truth = replace(
        campaign.landmarks,
        r_J=geodetic_to_itrf(np.full(3, latitude), longitude, np.zeros(3)),
        covariance_J=C @ np.diag(sigma**2) @ C.mT,
    )
    surveyed = truth.moved(truth.r_J + C @ np.array([3.0, -4.0, 8.0]))
    write_campaign(tmp_path / "b", replace(campaign, landmarks=surveyed))
    header, *rows = (tmp_path / "b" / "landmarks.csv").read_text().splitlines()
    stated = header.split(",").index("sigma_east_m")
    written = [[float(cell) for cell in row.split(",")[stated : stated + 3]] for row in rows]
    np.testing.assert_allclose(written, [sigma] * 3, rtol=1e-9)


def test_correlated_landmarks_are_not_written(tmp_path: Path) -> None:
    campaign = load(tmp_path / "a").campaign
    tilted = np.broadcast_to(TURN.as_matrix() @ np.diag([1.0, 4.0, 9.0]) @ TURN.as_matrix().T, (3, 3, 3))
    with pytest.raises(ValueError, match="not along east, north and up"):
        write_campaign(
            tmp_path / "b", replace(campaign, landmarks=replace(campaign.landmarks, covariance_J=tilted))
        )
    assert not (tmp_path / "b").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "driver"), [("l.gpkg", "GPKG"), ("l.geojson", "GeoJSON"), ("l.shp", "ESRI Shapefile")]
)
def test_landmarks_from_a_vector_file(tmp_path: Path, name: str, driver: str) -> None:
    raw = pytest.importorskip("pyogrio.raw")
    points = [
        np.array([1], "u1").tobytes() + np.array([1001], "<u4").tobytes() + np.array(p, "<f8").tobytes()
        for p in ((0.05, 0.05, 10.0), (0.05, -0.05, 20.0), (-0.06, 0.0, 30.0))
    ]
    path = write_good_campaign(tmp_path, campaign=CAMPAIGN.replace("landmarks.csv", name))
    ids, sigma = np.array(["L1", "L2", "L3"], dtype=object), np.full(3, 0.5)
    # a shapefile has ten letters for a name, one fewer than landmark_id
    fields = ["landmark_i" if driver == "ESRI Shapefile" else "landmark_id", "sigma_m"]
    raw.write(
        tmp_path / name,
        np.array(points, dtype=object),
        [ids, sigma],
        fields,
        geometry_type="Point Z",
        crs="EPSG:4979" if driver != "GeoJSON" else "EPSG:4326",
        driver=driver,
    )
    loaded = load_campaign(path)
    landmarks, expected = loaded.campaign.landmarks, load(tmp_path / "b").campaign.landmarks
    assert landmarks.ids == expected.ids
    assert len(loaded.inputs) == (10 if driver == "ESRI Shapefile" else 6)
    np.testing.assert_allclose(landmarks.r_J, expected.r_J, atol=1e-6)
    np.testing.assert_allclose(landmarks.covariance_J, expected.covariance_J, atol=1e-12)


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ("system", 'found the reference system "EPSG:32633", wanted EPSG:4326'),
        ("shape", "feature 1: found a geometry that is not a point"),
        ("height", "feature 1: found a point without height"),
        ("id", "attribute landmark_id: found nothing"),
        ("no-id", "wanted landmark_id too"),
        ("latitude", "column latitude_deg: found 95"),
        ("words", "attribute sigma_m: found"),
        ("no-file", "found a file that is not a vector file"),
    ],
)
def test_wrong_vector_files(tmp_path: Path, fault: str, says: str) -> None:
    raw = pytest.importorskip("pyogrio.raw")
    path = write_good_campaign(tmp_path, campaign=CAMPAIGN.replace("landmarks.csv", "l.geojson"))
    place = [0.05, 95.0 if fault == "latitude" else 0.05] + ([] if fault == "height" else [10.0])
    kind = {2: 1, 3: 1001}[len(place)]
    head = np.array([1], "u1").tobytes()
    wkb = head + np.array([kind], "<u4").tobytes() + np.array(place, "<f8").tobytes()
    if fault == "shape":
        wkb = head + np.array([2, 2], "<u4").tobytes() + np.array([0.0, 0.0, 1.0, 1.0], "<f8").tobytes()
    sigma = np.array(["half"], dtype=object) if fault == "words" else np.array([0.5])
    fields = ["name" if fault == "no-id" else "landmark_id", "sigma_m"]
    raw.write(
        tmp_path / "l.geojson",
        np.array([wkb], dtype=object),
        [np.array([None if fault == "id" else "L1"], dtype=object), sigma],
        fields,
        geometry_type={"shape": "LineString", "height": "Point"}.get(fault, "Point Z"),
        crs="EPSG:32633" if fault == "system" else "EPSG:4326",
        driver="GeoJSON",
    )
    if fault == "no-file":
        (tmp_path / "l.geojson").write_text("landmark_id,latitude_deg\n")
    with pytest.raises(InputError) as caught:
        load_campaign(path)
    assert "l.geojson" in str(caught.value)
    assert says in str(caught.value)
    assert str(caught.value).isprintable()
