"""Frame images of .tsai and SkySat files."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from starplumb.io.campaign.read import load_campaign
from starplumb.io.vendors.product import Wanted, import_product, import_products, read_product
from starplumb.physics.errors import InputError
from starplumb.physics.timescales import format_iso
from starplumb.table.geometry import stations

rasterio = pytest.importorskip("rasterio", reason="needs the extra gis")

pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")

C = np.array([6871000.0, 10000.0, -20000.0])
R = Rotation.from_euler("zy", [12.0, -91.0], degrees=True)
"""From the camera's axes to ITRF: z looks down, more or less."""
X = np.array([6371000.0, 15000.0, -12000.0])
"""A place on the ground."""


def image(tmp_path, name):
    profile = {"driver": "GTiff", "width": 30, "height": 20, "count": 1, "dtype": "uint8"}
    with rasterio.open(tmp_path / name, "w", **profile) as file:
        file.write(np.zeros((1, 20, 30), dtype=np.uint8))


def tsai(tmp_path, lens="NULL", pitch=0.0064, **changes):
    values = {
        "fu": f"{28.0 * pitch / 0.0064}",
        "fv": f"{28.0 * pitch / 0.0064}",
        "cu": f"{14.5 * pitch}",
        "cv": f"{9.75 * pitch}",
        "u_direction": "1 0 0",
        "v_direction": "0 1 0",
        "w_direction": "0 0 1",
        "C": " ".join(map(repr, C.tolist())),
        "R": " ".join(map(repr, R.as_matrix().ravel().tolist())),
        "pitch": str(pitch),
    } | changes
    lines = ["VERSION_4", "PINHOLE", *(f"{key} = {value}" for key, value in values.items()), lens]
    (tmp_path / "shot.tsai").write_text("\n".join(lines) + "\n")
    return tmp_path / "shot.tsai"


def seen(product, place):
    """The pixel of a place, by the model's own formula in a campaign."""
    campaign = product.campaign(1.0, 1.0)
    s = stations(campaign, np.array([0]), np.zeros(1))
    u = product.C_EK.T @ s.C_EJ[0] @ (place - s.r_J[0])
    return campaign.camera.px_from_tan(u[None, :2] / u[2])[0]


@pytest.mark.parametrize("pitch", [0.0064, 1.0])
def test_a_place_is_seen_where_the_formula_of_the_format_puts_it(tmp_path, pitch):
    """(fu Q1/Q3 + cu) / p with Q = R^-1 (P - C); lengths in millimetres, or in pixels with the pitch 1."""
    image(tmp_path, "shot.tif")
    q = R.inv().apply(X - C)
    f = 28.0 / 0.0064
    expected = [f * q[0] / q[2] + 14.5, f * q[1] / q[2] + 9.75]
    np.testing.assert_allclose(seen(read_product(tsai(tmp_path, pitch=pitch)), X), expected, rtol=1e-12)


def test_the_lens_is_that_of_opencv(tmp_path):
    """x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), by hand."""
    image(tmp_path, "shot.tif")
    k1, k2, p1, p2, k3 = 0.1, -0.2, 0.003, -0.002, 0.05
    lens = f"TSAI\nk1 = {k1}\nk2 = {k2}\np1 = {p1}\np2 = {p2}\nk3 = {k3}"
    q = R.inv().apply(X - C)
    x, y = q[:2] / q[2]
    r2 = x * x + y * y
    radial = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    f = 28.0 / 0.0064
    np.testing.assert_allclose(
        seen(read_product(tsai(tmp_path, lens)), X), [f * u + 14.5, f * v + 9.75], rtol=1e-12
    )


SKYSAT = "1259344359.55622339_sc00104_c2_PAN"


TO_CAMERA = Rotation.from_euler("xz", [180.0, 90.0], degrees=True)
"""From the body's axes to the camera's."""


def skysat(tmp_path, name=SKYSAT, up=False, mirrored=False, place=C, **changes):
    """As Planet writes them: negative focal lengths of 3.6 m in pixels of 6.5 um; z to the ground, or ``up``."""
    f = 3.6 / 6.5e-6
    turned = Rotation.from_euler("z" if not up else "x", 180.0, degrees=True) * R.inv()  # x, y of the camera
    body = TO_CAMERA.inv() * turned
    camera = np.array([[-f, 0.0, 14.5, 0.0], [0.0, -f, 9.75, 0.0], [0.0, 0.0, 1.0, 0.0]])
    if up:
        camera[1, 1] = f  # x, -y, -z of ours: u = -f x / z, v = f y / z
    if mirrored:
        camera[0, 0] *= -1.0
    intrinsic, extrinsic = np.eye(4), np.eye(4)
    intrinsic[:3, :3] = TO_CAMERA.as_matrix()
    extrinsic[:3, :3] = body.as_matrix()
    extrinsic[:3, 3] = -body.apply(place)
    document = {
        "P_camera": camera.tolist(),
        "P_extrinsic": extrinsic.tolist(),
        "P_intrinsic": intrinsic.tolist(),
        "P_projective": (camera @ intrinsic @ extrinsic).tolist(),
        "exterior_orientation": {
            f"{axis}_ecef_meters": x for axis, x in zip("xyz", place.tolist(), strict=True)
        },
    } | changes
    (tmp_path / f"{name}_pinhole.json").write_text(json.dumps(document))
    image(tmp_path, f"{name}.tif")
    return tmp_path / f"{name}_pinhole.json"


@pytest.mark.parametrize("up", [False, True])
def test_the_matrices_of_skysat_project_a_place_to_its_pixel(tmp_path, up):
    path = skysat(tmp_path, up=up)
    document = json.loads(path.read_text())
    names = ("P_camera", "P_intrinsic", "P_extrinsic")
    camera, intrinsic, extrinsic = (np.array(document[name]) for name in names)
    pixel = camera @ intrinsic @ extrinsic @ np.append(X, 1.0)
    product = read_product(path)
    np.testing.assert_allclose(seen(product, X), pixel[:2] / pixel[2], rtol=1e-9)
    np.testing.assert_allclose(product.r_J[0], C, atol=1e-6)
    assert product.C_EK[2, 2] == 1.0
    assert product.name == SKYSAT
    assert (product.columns, product.rows, product.notices) == (30, 20, ())


@pytest.mark.parametrize(
    ("name", "utc"),
    [
        (SKYSAT, "2019-12-02T17:52:21.556223"),
        # published beside each other: the image and its delivery, s4_20181107T175036Z_video
        ("1225648254.44006968_sc00004_c1_PAN", "2018-11-07T17:50:36.440070"),
    ],
)
def test_the_name_says_the_time_in_seconds_of_gps(tmp_path, name, utc):
    product = read_product(skysat(tmp_path, name=name))
    assert format_iso(np.array([product.t_ns]), "UTC", 6) == [utc]


def test_import_makes_a_campaign(tmp_path):
    image(tmp_path, "shot.tif")
    (tmp_path / "landmarks.csv").write_text(
        "landmark_id,latitude_deg,longitude_deg,height_m,sigma_m\na,0,0,0,1\n"
    )
    (tmp_path / "seen.csv").write_text("image_id,landmark_id,column_px,row_px,sigma_px\nshot,a,7.5,8,1\n")
    tables = {"landmarks": tmp_path / "landmarks.csv", "observations": tmp_path / "seen.csv"}
    notices = import_product(tsai(tmp_path), tmp_path / "out", sigma_m=3.0, sigma_arcsec=5.0, **tables)
    assert any("states no time" in notice for notice in notices)
    loaded = load_campaign(tmp_path / "out" / "campaign.toml").campaign
    np.testing.assert_allclose(loaded.ephemeris.r_J, [C])


@pytest.mark.parametrize("make", [tsai, skysat])
def test_frames_of_one_camera_are_one_campaign(tmp_path, make):
    """Each stands where it stands alone, with a time of its own or without."""
    paths = []
    for k in range(3):
        folder = tmp_path / str(k)
        folder.mkdir()
        place = C + 1000.0 * k * np.array([1.0, 0.0, 0.0])
        if make is tsai:
            path = tsai(folder, C=" ".join(map(repr, place.tolist()))).rename(folder / f"frame_{k}.tsai")
            image(folder, f"frame_{k}.tif")
        else:
            path = skysat(folder, name=f"125934435{9 + k}.5_sc00104_c2_PAN", place=place)
        paths.append(path)
    wanted = Wanted(sigma_m=3.0, sigma_arcsec=5.0)
    import_products(paths, tmp_path / "out", wanted)
    campaign = load_campaign(tmp_path / "out" / "campaign.toml").campaign
    together = stations(campaign, np.arange(3), np.zeros(3))
    for k, path in enumerate(paths):
        product = read_product(path)
        alone = stations(product.campaign(3.0, 5.0), np.array([0]), np.zeros(1))
        np.testing.assert_allclose(together.r_J[k], alone.r_J[0], atol=1e-5)
        np.testing.assert_allclose(together.C_EJ[k], alone.C_EJ[0], atol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: tsai(path, "Photometrix"), 'found the lens "Photometrix", wanted NULL or TSAI'),
        (lambda path: tsai(path, fv="29"), "wanted equal ones"),
        (lambda path: tsai(path, R="1 0 0 0 1 0 0 0 2"), "found a matrix that is no rotation"),
        (lambda path: tsai(path, C="1 2 3"), "m from the Earth's centre"),
        (lambda path: tsai(path, C="1 2 x"), 'C: found "1 2 x", wanted 3 finite numbers'),
        (lambda path: tsai(path, u_direction="0 1 0"), "wanted them in R instead"),
        (lambda path: tsai(path, pitch=0.0, fu="1", fv="1", cu="1", cv="1"), "pitch: found 0"),
        (lambda path: skysat(path, P_extrinsic=[[1.0]]), "P_extrinsic: found"),
        (lambda path: skysat(path, mirrored=True), "found a matrix that is no rotation"),
        (lambda path: skysat(path, P_camera=[[0.0] * 4] * 3), "P_camera: found"),
        (
            lambda path: skysat(path, P_camera=[[-5e5, 5e3, 14, 0], [0, -5e5, 9, 0], [0, 0, 1, 0]]),
            "square pixels",
        ),
        (
            lambda path: skysat(path, P_projective=[[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]),
            "P_projective: found",
        ),
        (
            lambda path: skysat(
                path, exterior_orientation={"x_ecef_meters": 7e6, "y_ecef_meters": 0, "z_ecef_meters": 0}
            ),
            "wanted the place that P_extrinsic has",
        ),
    ],
)
def test_what_cannot_be_used_is_said(tmp_path, make, message):
    image(tmp_path, "shot.tif")
    with pytest.raises(InputError) as error:
        read_product(make(tmp_path))
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_the_image_beside_it_gives_the_size(tmp_path):
    with pytest.raises(
        InputError, match=r"shot\.tsai: found no image shot\.tif beside it, wanted it for its size"
    ):
        read_product(tsai(tmp_path))
