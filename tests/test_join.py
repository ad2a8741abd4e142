"""Several products in one campaign, written together or one after the other; each must locate as it does alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import starplumb as sp
from starplumb.cli.app import app
from starplumb.io.campaign.read import load_campaign
from starplumb.io.vendors.join import Named, joined
from starplumb.physics import so3
from starplumb.physics.errors import InputError
from starplumb.physics.orientation import EarthOrientation
from starplumb.table.campaign import some_of
from starplumb.table.geometry import locate
from test_csm import scanner

SIGMAS = ("--sigma-m", "3", "--sigma-arcsec", "5,5,12")


def run(*arguments):
    return CliRunner().invoke(app, ["import", *map(str, arguments)], catch_exceptions=True)


@pytest.fixture
def products(tmp_path):
    """Three images of one camera, half a minute apart."""
    for name, start in (("a", 1000.0), ("b", 1030.0), ("c", 1060.0)):
        scanner(tmp_path, name=f"{name}.json", m_centerEphemerisTime=start)
    return [tmp_path / f"{name}.json" for name in "abc"]


def places(path):
    """Where every image sees a few of its pixels, by its id."""
    campaign = load_campaign(path / "campaign.toml").campaign
    column, row = np.array([0.0, 7.0, 15.0]), np.array([0.0, 8.0, 15.0])
    return {
        name: locate(campaign, campaign.C_EK, np.full(3, i), column, row)
        for i, name in enumerate(campaign.images.ids)
    }


def alone(tmp_path, products):
    found = {}
    for name, product in zip("ABC", products, strict=False):
        assert run(product, tmp_path / name, *SIGMAS, "--image-id", name).exception is None
        found |= places(tmp_path / name)
    return found


def assert_same(found, wanted):
    assert found.keys() == wanted.keys()
    for name, r_J in found.items():
        np.testing.assert_allclose(r_J, wanted[name], rtol=0, atol=1e-3)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
def test_products_together_see_what_each_sees_alone(tmp_path, products, order):
    names = ",".join("ABC"[i] for i in order)
    done = run(*(products[i] for i in order), tmp_path / "all", *SIGMAS, "--image-id", names)
    assert done.exception is None
    assert_same(places(tmp_path / "all"), alone(tmp_path, products))


def test_a_product_is_added_and_what_the_user_wrote_stays(tmp_path, products):
    folder = tmp_path / "grown"
    run(products[0], folder, *SIGMAS, "--image-id", "A")
    path = folder / "campaign.toml"
    path.write_text("# mine\n" + path.read_text().replace("[ephemeris]", "[ephemeris] # surveyed twice"))
    (folder / "landmarks.csv").write_text(
        "landmark_id,latitude_deg,longitude_deg,height_m,sigma_m\nL1,0,0,0,1\n"
    )
    (folder / "observations.csv").write_text("image_id,landmark_id,column_px,row_px,sigma_px\nA,L1,3,4,0.5\n")
    for name, product in (("B", products[1]), ("C", products[2])):
        assert (
            run(product, "--into", folder, "--image-id", name).exception is None
        )  # the campaign's sigmas hold
    assert_same(places(folder), alone(tmp_path, products))
    text = path.read_text()
    assert text.startswith("# mine\n")
    assert "# surveyed twice" in text
    again = load_campaign(path).campaign
    assert again.landmarks.ids == ("L1",)
    assert (again.sightings.column_px.tolist(), again.sightings.row_px.tolist()) == ([3.0], [4.0])
    np.testing.assert_array_equal(again.sigma_position, [3.0, 3.0, 3.0])


def test_a_fresh_import_is_located_with_and_checked_at_once(tmp_path, products):
    run(*products[:2], tmp_path / "fresh", *SIGMAS, "--image-id", "A,B")
    campaign = sp.read_campaign(tmp_path / "fresh" / "campaign.toml")
    place = sp.locate(campaign, image="B", column=4.0, row=5.0, height_m=0.0)
    pixel = sp.project(campaign, itrf_m=place.document["itrf_m"], image="B").document["points"][0]
    np.testing.assert_allclose([pixel["column_px"], pixel["row_px"]], [4.0, 5.0], atol=1e-3)
    check = sp.check(campaign)
    assert "found no rows yet, wanted at least one observation" in check.problems[0]
    with pytest.raises(InputError, match="found no rows yet"):
        sp.calibrate(campaign)


def test_names_of_one_image_collide(tmp_path, products):
    done = run(*products[:2], tmp_path / "all", *SIGMAS, "--image-id", "A,A")
    assert 'b.json: found the image "A" that the campaign has already' in str(done.exception)
    assert not (tmp_path / "all").exists()
    done = run(*products[:2], tmp_path / "all", *SIGMAS, "--image-id", "A")
    assert "image_id: found 1 names for 2 products" in str(done.exception)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"m_focalLength": 51.0}, "b.json: found another camera than that of a.json"),
        ({"m_centerEphemerisTime": 1000.5}, "overlap in time those of a.json and differ"),
    ],
)
def test_what_cannot_stand_in_one_campaign_is_refused(tmp_path, products, changes, says):
    scanner(tmp_path, name="b.json", **({"m_centerEphemerisTime": 1030.0} | changes))
    done = run(*products[:2], tmp_path / "all", *SIGMAS, "--image-id", "A,B")
    assert says in str(done.exception)
    assert not (tmp_path / "all").exists()


def test_the_vendors_of_the_real_products_have_two_cameras(shared_data, tmp_path):
    quickbird, pleiades = shared_data / "quickbird2", shared_data / "pleiades1b"
    optics = ("--principal-distance-mm", "8836.202", "--detector-pitch-mm", "0.01191396")
    done = run(quickbird, pleiades, tmp_path / "all", *SIGMAS, *optics, "--detector-origin-mm", "9.5,164.0")
    assert isinstance(done.exception, InputError)
    assert not (tmp_path / "all").exists()


def later(campaign, seconds, name, landmarks=True):
    """The demo so many seconds later, its images renamed."""
    shift = round(seconds * 1e9)
    images = replace(
        campaign.images,
        t_ns=campaign.images.t_ns + shift,
        ids=tuple(f"{name}{i}" for i in range(len(campaign.images.ids))),
    )
    orbit = replace(campaign.ephemeris, t_ns=campaign.ephemeris.t_ns + shift)
    attitude = replace(campaign.attitude, t_ns=campaign.attitude.t_ns + shift)
    return replace(campaign, images=images, ephemeris=orbit, attitude=attitude)


@pytest.fixture(scope="module")
def demo():
    return sp.demo(images=2).loaded.campaign


def test_frames_of_attitude_are_brought_together(demo):
    """The second campaign gives its attitude from the Earth-fixed frame."""
    other = later(demo, 3600.0, "b")
    C_EJ = so3.from_quaternion(other.attitude.q_EF) @ EarthOrientation.load().C_IJ(other.attitude.t_ns)
    fixed = replace(
        other,
        attitude=replace(other.attitude, q_EF=so3.to_quaternion(C_EJ), frame="ITRF", orientation=None),
    )
    whole = joined([Named("a", demo), Named("b", fixed)])
    assert whole.attitude.frame == "GCRF"
    n = demo.attitude.t_ns.size
    np.testing.assert_allclose(
        so3.from_quaternion(whole.attitude.q_EF[n:]), so3.from_quaternion(other.attitude.q_EF), atol=1e-14
    )


def test_landmarks_of_one_id_are_one_place(demo):
    whole = joined([Named("a", demo), Named("b", later(demo, 3600.0, "b"))])
    assert whole.landmarks.ids == demo.landmarks.ids
    n = demo.sightings.image.size
    np.testing.assert_array_equal(whole.sightings.landmark[n:], demo.sightings.landmark)
    np.testing.assert_array_equal(whole.sightings.image[n:], demo.sightings.image + 2)
    moved = replace(demo.landmarks, r_J=demo.landmarks.r_J + 1.0)
    other = replace(later(demo, 3600.0, "b"), landmarks=moved)
    with pytest.raises(InputError, match=r'b: found the landmark "gcp001" at another place than before'):
        joined([Named("a", demo), Named("b", other)])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"sigma_position": np.array([9.0, 9.0, 9.0])}, "b: found another sigma_m than that of a"),
        ({"C_EK": so3.exp(np.array([1e-3, 0.0, 0.0]))}, "b: found another model mounting than that of a"),
    ],
)
def test_what_a_campaign_has_once_is_the_same(demo, change, says):
    with pytest.raises(InputError) as refused:
        joined([Named("a", demo), Named("b", replace(later(demo, 3600.0, "b"), **change))])
    assert says in str(refused.value)


def test_images_at_one_time_with_two_orbits_are_refused(demo):
    moved = replace(demo.ephemeris, r_J=demo.ephemeris.r_J + 5.0)
    other = later(replace(demo, ephemeris=moved), 0.03, "b")
    with pytest.raises(
        InputError, match=r"b: found images and orbit that overlap in time those of a and differ"
    ):
        joined([Named("a", demo), Named("b", other)])


@pytest.mark.parametrize("metres", [0.0, 5.0])
def test_a_camera_that_joining_would_move_is_refused(demo, metres):
    """The first orbit ends one sample after its last image; the next sample is the second's, so many metres off."""
    t_ns = demo.ephemeris.t_ns
    step = t_ns[1] - t_ns[0]
    kept = t_ns <= demo.images.t_ns[-1] + step
    between = replace(demo.images, t_ns=demo.images.t_ns + step // 3)  # on a sample nothing is interpolated
    short = replace(demo, images=between, ephemeris=replace(demo.ephemeris, **of(demo.ephemeris, kept)))
    start = t_ns > demo.images.t_ns[-1] + step
    after = replace(demo.ephemeris, **of(demo.ephemeris, start))
    after = replace(after, r_J=after.r_J + metres)
    images = replace(demo.images, ids=("b0", "b1"), t_ns=after.t_ns[[2, 4]])
    attitude = replace(demo.attitude, t_ns=demo.attitude.t_ns, q_EF=demo.attitude.q_EF)
    other = replace(demo, ephemeris=after, images=images, attitude=attitude, sightings=none(demo))
    parts = [Named("a", short), Named("b", other)]
    if not metres:
        joined(parts)
        return
    with pytest.raises(InputError, match=r"joined with the others its camera would move by .* m"):
        joined(parts)


def of(orbit, chosen):
    return {"t_ns": orbit.t_ns[chosen], "r_J": orbit.r_J[chosen], "v_J": orbit.v_J[chosen]}


def none(campaign):
    return some_of(campaign.sightings, np.arange(0))


def test_into_a_folder_that_is_not_there_is_an_import(tmp_path, products):
    assert run(*products[:2], "--into", tmp_path / "new", *SIGMAS, "--image-id", "A,B").exception is None
    assert set(places(tmp_path / "new")) == {"A", "B"}


def test_a_campaign_of_its_own_form_is_not_rewritten(tmp_path, products):
    folder = tmp_path / "own"
    run(products[0], folder, *SIGMAS, "--image-id", "A")
    path = folder / "campaign.toml"
    before = path.read_text()
    path.write_text(before.replace('file = "ephemeris.csv"', 'file = "ephemeris.csv"\nkeep = { x_m = 1 }'))
    done = run(products[1], "--into", folder, "--image-id", "B")
    assert isinstance(done.exception, InputError)
    (folder / "orbit.csv").write_text((folder / "ephemeris.csv").read_text())
    path.write_text(before.replace('"ephemeris.csv"', '"orbit.csv"'))
    done = run(products[1], "--into", folder, "--image-id", "B")
    assert "found ephemeris in a file of its own form" in str(done.exception)


def test_one_argument_is_not_enough(products):
    assert "found one argument, wanted a product and the folder" in str(run(products[0]).exception)
