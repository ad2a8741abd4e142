"""The door: ``import starplumb as sp`` and a whole session, without files where none are wanted."""

from __future__ import annotations

import ast
import csv
import json
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest

import starplumb as sp
from command import demo as written_demo
from command import starplumb
from helpers import CAMPAIGN, FILES, write_good_campaign
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.session.frames import Frame
from starplumb.session.ground.location import place, view_of

PACKAGE = Path(sp.__file__).parent


@pytest.fixture(scope="module")
def campaign():
    return sp.demo(images=4, seed=7)


@pytest.fixture(scope="module")
def result(campaign):
    return sp.calibrate(campaign)


def test_the_answer_is_the_truth_within_its_sigma(campaign, result):
    assert result.status == "ok"
    error = so3.log(result.C_EK @ campaign.C_EK_true.mT) / ARCSEC
    assert np.all(np.abs(error) < 4.0 * result.sigma_arcsec)
    assert np.all(result.sigma_arcsec < 20.0)
    covariance = result.covariance_arcsec2
    np.testing.assert_allclose(np.sqrt(np.diagonal(covariance)), result.sigma_arcsec)
    applied = so3.exp(result.correction_arcsec * ARCSEC) @ campaign.C_EK
    np.testing.assert_allclose(applied, result.C_EK, atol=1e-14)


def test_saving_writes_the_very_files_of_the_command(tmp_path):
    path = written_demo(tmp_path / "demo", "--images", 3)
    assert starplumb("calibrate", path, "--out", tmp_path / "command", "-e", "focal_length").status == 0
    sp.calibrate(sp.read_campaign(path), ["focal_length"]).save(tmp_path / "session")
    files = {file.name: file.read_bytes() for file in (tmp_path / "command").iterdir()}
    assert set(files) == {"result.json", "residuals.csv", "report.html", "mounting.tf", "normals.json"}
    assert files == {file.name: file.read_bytes() for file in (tmp_path / "session").iterdir()}


def test_the_demo_is_that_of_init(tmp_path):
    path = written_demo(tmp_path / "demo", "--images", 3, "--camera", "line-scan", "--seed", 5)
    there, here = sp.read_campaign(path), sp.demo("line-scan", images=3, seed=5)
    assert np.array_equal(there.C_EK_true, here.C_EK_true)
    assert sp.calibrate(there).document == sp.calibrate(here).document


def test_residuals_as_a_frame_are_the_columns_of_the_file(result, tmp_path):
    pytest.importorskip("pandas")
    result.save(tmp_path, report=False)
    frame = result.residuals.to_frame()
    with (tmp_path / "residuals.csv").open(newline="", encoding="utf-8") as lines:
        file = list(csv.DictReader(lines))
    assert list(frame.columns) == list(file[0])
    for name in frame.columns:
        if frame[name].dtype.kind == "f":
            cells = [float(row[name] or "nan") for row in file]
            np.testing.assert_array_equal(frame[name].to_numpy(float), cells)
        else:
            assert [str(value) for value in frame[name]] == [row[name] for row in file]
    assert len(result.residuals) == len(file) == 48


def test_residuals_go_to_any_library_of_frames(result):
    polars = pytest.importorskip("polars", reason="polars is not installed")
    expected = result.residuals.to_dict()
    polars = polars.DataFrame(result.residuals).to_dict(as_series=False)
    for made in (polars, pa.table(result.residuals).to_pydict()):
        assert list(made) == list(expected)
        for name in ("image_id", "column_px", "normalised"):
            np.testing.assert_array_equal(made[name], expected[name])


def test_objects_are_themselves_and_no_other(campaign, result):
    assert campaign == campaign
    assert campaign != sp.demo()
    assert len({result, campaign, result}) == 2


def test_an_argument_that_no_function_has_names_the_function(campaign):
    with pytest.raises(TypeError, match="calibrate: got an unexpected keyword argument 'methd'"):
        sp.calibrate(campaign, methd="gls")


def test_objects_are_shown_shortly_and_safely(campaign, result):
    assert "control and 8 check observations" in repr(campaign)
    text = repr(result)
    assert "correction" in text
    assert f"{result.sigma_arcsec[2]:.3f}" in text
    assert len(text) < 2000
    html = result._repr_html_()
    assert f"<td>{result.sigma_arcsec[2]:.3f}</td>" in html
    assert "residuals: 48 rows" in repr(result.residuals).lower()


def test_names_are_escaped_in_a_notebook(tmp_path):
    path = written_demo(tmp_path / "demo", "--images", 2)
    text = path.read_text(encoding="utf-8").replace(
        'name = "starplumb demo"', 'name = "<script>alert(1)</script>"'
    )
    path.write_text(text, encoding="utf-8")
    found = sp.read_campaign(path)
    for shown in (found, sp.calibrate(found)):
        assert "<script>" not in shown._repr_html_()
        assert "&lt;script&gt;" in shown._repr_html_()


@pytest.mark.slow
def test_figures_are_returned_and_leave_no_global_state(campaign, result):
    import matplotlib.figure

    figures = [
        *(
            result.plot_residuals(where, when)
            for where in ("image", "ground")
            for when in ("before", "after")
        ),
        result.plot_trend("latitude", shared_errors=False),
        result.plot_ground(),
        result.plot_alignment("yz"),
        result.plot_budget(),
    ]
    assert all(isinstance(figure, matplotlib.figure.Figure) for figure in figures)
    arrows = figures[3].axes[0].collections
    assert sum(len(quiver.U) for quiver in arrows) == 48
    assert "matplotlib.pyplot" not in sys.modules or not sys.modules["matplotlib.pyplot"].get_fignums()


def test_an_answer_that_must_not_be_used_is_returned_and_says_so(tmp_path):
    path = written_demo(tmp_path / "demo", "--images", 1)
    table = path.parent / "observations.csv"
    lines = table.read_text(encoding="utf-8").splitlines()
    control = [line for line in lines[1:] if line.endswith("control")]
    table.write_text("\n".join([lines[0], control[0]]) + "\n", encoding="utf-8")
    result = sp.calibrate(sp.read_campaign(path))
    assert (result.status, result.usable) == ("singular", False)
    with pytest.raises(sp.AlignmentFailed, match=r"campaign\.toml: "):
        result.raise_if_unusable()
    with pytest.raises(sp.AlignmentFailed):
        result.plot_alignment()
    with pytest.raises(sp.AlignmentFailed):
        sp.locate(result.campaign, result, image="image01", column=1, row=1)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method": "glss"}, "method: found 'glss'.*did you mean gls"),
        ({"estimate": ""}, "estimate: found '', wanted one or more of focal_length"),
        ({"method": "wahba", "estimate": ["focal_length"]}, "estimate: found with the method wahba"),
        ({"estimate": "focal_lenght"}, "focal_lenght"),
    ],
)
def test_a_mistake_is_one_sentence(campaign, options, words):
    with pytest.raises(sp.InputError, match=words):
        sp.calibrate(campaign, **options)


def test_an_estimator_of_ones_own_is_taken(campaign, result):
    from starplumb.estimators.gls import Gls

    class Mine:
        def __call__(self, observations, C_EK):
            return Gls()(observations, C_EK)

    own = sp.calibrate(campaign, method=Mine())
    assert own.method == "Mine"
    np.testing.assert_array_equal(own.C_EK, result.C_EK)
    with pytest.raises(sp.InputError, match="estimator of your own"):
        sp.calibrate(campaign, ["focal_length"], method=Mine())


def test_comparison_and_diagnosis_of_a_campaign(campaign, result):
    comparison = sp.compare(campaign)
    assert "not stated" in repr(comparison)
    first = comparison.document["methods"][0]
    assert first["method"] == "gls"
    np.testing.assert_allclose(first["correction_arcsec"], result.correction_arcsec)
    assert len(comparison.frame) == len(comparison.answers)
    diagnosis = sp.diagnose(campaign)
    assert diagnosis.verdict == "none"
    assert "No usual mistake" in repr(diagnosis)


def test_a_place_on_the_ground_is_that_of_the_command(campaign, result, tmp_path):
    result.save(tmp_path, report=False)
    place = sp.locate(campaign, result, image="image02", column=5000, row=6000.5, height_m=100.0)
    read = sp.locate(
        campaign, tmp_path / "result.json", image="image02", column=5000, row=6000.5, height_m=100.0
    )
    np.testing.assert_allclose(read.document["itrf_m"], place.document["itrf_m"], atol=1e-6)
    np.testing.assert_allclose(read.covariance_east_north_up_m2, place.covariance_east_north_up_m2, rtol=1e-9)
    assert place.height_m == pytest.approx(100.0, abs=1e-6)
    assert f"latitude {place.latitude_deg:.7f}" in repr(place)


def test_a_scenario_is_budgeted_and_simulated(tmp_path):
    scenario = sp.scenario("two-images")
    assert "two-images" in repr(scenario)
    budget = sp.budget(scenario, target_arcsec=1.0)
    frame = budget.frame.to_dict()
    sigma = budget.document["methods"]["gls"]["sigma_arcsec"]
    for axis, whole in zip("xyz", sigma, strict=True):
        parts = np.array(frame[f"contribution_{axis}_arcsec"])
        assert np.sqrt(np.sum(parts**2)) == pytest.approx(whole, rel=1e-6)
    study = sp.simulate(scenario, trials=300, seed=1, methods="gls")
    assert study.document["trials"] == 300
    assert "error / stated" in repr(study.summary())
    rms = study.summary().frame.to_dict()["rms_arcsec"]
    assert np.all(np.abs(np.array(rms) / sigma - 1.0) < 5.0 / np.sqrt(2 * 300))
    study.save(tmp_path)
    written = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert {"report.html", "histogram-gls.svg"} < set(written.pop("files"))
    assert written == study.document
    assert (tmp_path / "histogram-gls.svg").read_text(encoding="utf-8").count("<svg") == 1


def test_a_scenario_may_be_a_dictionary():
    path = PACKAGE / "scenarios" / "two-images.toml"
    document = tomllib.loads(path.read_text(encoding="utf-8"))
    here, there = sp.scenario(document), sp.scenario("two-images")
    assert here.data.digest == there.data.digest
    document["scenario"]["name"] = "mine"
    assert "'mine'" in repr(sp.scenario(document))


def test_the_door_opens_lazily_and_its_types_agree():
    code = "import sys, starplumb as sp; before = set(sys.modules); assert 'calibrate' in dir(sp); print(*before)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"numpy", "starplumb.session.result"} & set(done.stdout.split())
    stub = ast.parse((PACKAGE / "__init__.pyi").read_text(encoding="utf-8"))
    typed = {
        alias.name: node.module
        for node in stub.body
        if isinstance(node, ast.ImportFrom) and node.level
        for alias in node.names
    }
    assert typed == sp._DOOR
    for name in sp._DOOR:
        assert getattr(sp, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'colour'"):
        _ = sp.colour


@pytest.fixture(scope="module")
def at_the_horizon(tmp_path_factory):
    """The camera of the campaign by hand turned by 90 deg about x: it looks along the horizon."""
    text = CAMPAIGN.replace("[0.0, 0.0, 0.0, 1.0]", "[0.7071067811865476, 0.0, 0.0, 0.7071067811865476]")
    return write_good_campaign(tmp_path_factory.mktemp("horizon"), campaign=text)


def test_a_line_of_sight_that_misses_the_earth_is_refused(at_the_horizon):
    with pytest.raises(sp.InputError, match=r"pixel \(5, 7\) of I1 misses the Earth") as refused:
        sp.locate(sp.read_campaign(at_the_horizon), image="I1", column=5, row=7)
    assert str(refused.value).startswith(str(at_the_horizon))


def ground_at(known):
    """Ground at height 0 where ``known`` says so of latitudes (rad), and unknown elsewhere."""
    return SimpleNamespace(
        dem=SimpleNamespace(path="dem.tif", step_m=30.0),
        at=lambda latitude, longitude: np.where(known(latitude), 0.0, np.nan),
    )


def test_a_pixel_without_ground_in_the_height_model_is_refused(tmp_path):
    campaign = sp.read_campaign(write_good_campaign(tmp_path))
    view, pixel = view_of(campaign, None, "I1"), (6000.0, 0.0)
    level = place(view, pixel, 0.0, 0.0)
    latitude = np.deg2rad(level.latitude_deg)
    up = np.sign(latitude - np.deg2rad(place(replace(view, height_m=5000.0), pixel, 0.0, 0.0).latitude_deg))
    cases = {
        "nowhere": lambda angle: np.full(angle.shape, False),
        "only where the ray is still high above it": lambda angle: up * (latitude - angle) > 1e-6,
    }
    for known in cases.values():
        with pytest.raises(sp.InputError, match=r"^dem\.tif: found no ground under pixel \(6000, 0\) of I1"):
            place(replace(view, surface=ground_at(known)), pixel, 0.0, 0.0)
    everywhere = place(replace(view, surface=ground_at(lambda a: np.full(a.shape, True))), pixel, 0.0, 0.0)
    assert everywhere.document["itrf_m"] == pytest.approx(level.document["itrf_m"], abs=1e-3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"image": "I9"}, "image: found 'I9', wanted one of I1, I2"),
        ({"height_m": float("inf")}, "height_m: found inf"),
        ({"height_m": 1.0, "dem": "dem.tif"}, "height_m: found beside a DEM"),
        ({"column": 12000}, "COLUMN: found 12000, wanted -0.5 to 11999.5"),
        ({"row": -0.6}, "ROW: found -0.6, wanted -0.5 to 11999.5"),
    ],
)
def test_what_cannot_be_located_is_refused(tmp_path, options, words):
    campaign = sp.read_campaign(write_good_campaign(tmp_path))
    with pytest.raises(sp.InputError, match=words):
        sp.locate(campaign, **({"image": "I1", "column": 1, "row": 1} | options))


SETTINGS = tomllib.loads(CAMPAIGN)
TABLES = {name.removesuffix(".csv"): text for name, text in FILES.items() if name != "campaign.toml"}


def columns_of(text):
    """The columns of a table as Python lists: numbers where all cells are."""
    head, *rows = [line.split(",") for line in text.splitlines()]
    columns = {name: list(cells) for name, cells in zip(head, zip(*rows, strict=True), strict=True)}
    number = re.compile(r"-?[0-9.]+$")
    return {k: [float(c) for c in v] if all(map(number.match, v)) else v for k, v in columns.items()}


@pytest.mark.parametrize("kind", ["columns", "pandas", "polars", "pyarrow", "paths"])
def test_a_campaign_is_built_from_tables(kind, tmp_path):
    path = write_good_campaign(tmp_path)
    make = {"columns": dict, "paths": None}.get(kind)
    if kind in ("pandas", "polars"):
        make = pytest.importorskip(kind).DataFrame
    elif kind == "pyarrow":
        make = pytest.importorskip(kind).table
    tables = {n: tmp_path / f"{n}.csv" if make is None else make(columns_of(t)) for n, t in TABLES.items()}
    settings = {key: {k: v for k, v in part.items() if k != "file"} for key, part in SETTINGS.items()}
    settings = {key: part for key, part in settings.items() if part}
    built = sp.Campaign.from_tables(settings, **tables)
    assert repr(built) == repr(sp.read_campaign(path))
    here, there = sp.calibrate(built), sp.calibrate(sp.read_campaign(path))
    np.testing.assert_allclose(here.C_EK, there.C_EK, rtol=0, atol=1e-15)
    np.testing.assert_allclose(here.covariance_arcsec2, there.covariance_arcsec2, rtol=1e-12)


def test_a_key_of_none_is_a_key_left_out():
    document = tomllib.loads((PACKAGE / "scenarios" / "two-images.toml").read_text(encoding="utf-8"))
    document["camera"]["distortion"] = None
    assert sp.scenario(document).data.digest == sp.scenario("two-images").data.digest
    document["camera"]["focal_length_mm"] = None
    with pytest.raises(sp.InputError, match=r"camera.focal_length_mm: missing"):
        sp.scenario(document)


@pytest.mark.parametrize(
    ("section", "key", "words"),
    [
        ("camera", "focal_length_mm", "camera.focal_length_mm: missing"),
        ("mounting", "quaternion_xyzw", r"mounting\.quaternion_xyzw: missing"),
        ("attitude", None, "attitude"),
        ("observations", None, "observations"),
    ],
)
def test_settings_of_none_are_refused_as_missing(section, key, words):
    settings = {name: dict(part) for name, part in SETTINGS.items()}
    if key is None:
        settings[section] = None
    else:
        settings[section][key] = None
    with pytest.raises(sp.InputError, match=words):
        sp.Campaign.from_tables(settings)


@pytest.mark.parametrize("settings", [None, [], 3])
def test_settings_of_another_type_are_refused(settings):
    with pytest.raises(
        sp.InputError, match=r"^settings: found .*wanted the path of campaign.toml or its keys"
    ):
        sp.Campaign.from_tables(settings)


@pytest.mark.parametrize("trials", [0, -1])
def test_a_study_of_no_trials_is_refused(trials):
    with pytest.raises(sp.InputError, match=f"^trials: found {trials}, wanted a whole number from 2 to "):
        sp.simulate(sp.scenario("two-images"), trials=trials)


def test_one_trial_has_no_scatter_and_is_refused():
    with pytest.raises(sp.InputError, match="trials: found 1, wanted a whole number from 2 to "):
        sp.simulate(sp.scenario("two-images"), trials=1)


@pytest.mark.parametrize("samples", ["rubbish", "netcdf", "parquet"])
def test_samples_without_a_folder_are_refused(samples):
    with pytest.raises(sp.InputError, match="samples: found"):
        sp.simulate(sp.scenario("two-images"), trials=4, samples=samples)


def test_the_demo_has_at_most_forty_images():
    with pytest.raises(sp.InputError, match="images: found 41, wanted a whole number from 1 to 40"):
        sp.demo(images=41)


@pytest.mark.parametrize("target", [0.0, -1.0, float("nan"), float("inf")])
def test_a_budget_for_no_sigma_is_refused(target):
    with pytest.raises(sp.InputError, match=r"^target_arcsec: found .*, wanted a positive number"):
        sp.budget(sp.scenario("two-images"), target_arcsec=target)


def test_a_wrong_cell_of_a_frame_is_named(tmp_path):
    path = write_good_campaign(tmp_path)
    images = columns_of(FILES["images.csv"])
    images["time"][1] = "yesterday"
    with pytest.raises(sp.InputError, match=r"row 1.*time.*yesterday"):
        sp.Campaign.from_tables(path, images=images)


def numbered(rows):
    """A frame of so many rows with a number that does not exist in the second."""
    value = np.ma.MaskedArray(np.arange(float(rows)), mask=np.arange(rows) == 1)
    return Frame("numbers", ("name", "value"), ([f"n{i}" for i in range(rows)], value))


def test_a_number_that_does_not_exist_is_nan_in_a_frame():
    value = numbered(3).to_dict()["value"]
    assert type(value) is np.ndarray
    np.testing.assert_array_equal(value, [0.0, np.nan, 2.0])
    pandas = pytest.importorskip("pandas")
    assert numbered(3).to_frame()["value"].isna().tolist() == [False, True, False]
    assert isinstance(numbered(3).to_frame(), pandas.DataFrame)


@pytest.mark.parametrize(("rows", "title"), [(5, "numbers: 5 rows"), (6, "numbers: 6 rows, the first 5")])
def test_five_rows_of_a_frame_are_shown(rows, title):
    (table,) = numbered(rows).tables
    assert table.caption == title
    assert [row[0] for row in table.rows] == ["n0", "n1", "n2", "n3", "n4"]
    assert [row[1] for row in table.rows] == ["0", "nan", "2", "3", "4"]
    assert len(numbered(rows)) == rows
    assert len(Frame("empty", (), ())) == 0


def test_a_frame_without_pandas_names_the_way_out(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(sp.InputError, match=r"to_frame needs pandas.*pip install pandas. or use to_dict"):
        numbered(2).to_frame()


@pytest.mark.parametrize("camera", ["frame", "line-scan"])
def test_an_example_without_files_names_no_folder(camera):
    """The folder that the example was read from is gone; what is said of its files goes by their bare names."""
    import tempfile

    campaign = sp.demo(camera, 2)
    told = f"{sp.check(campaign)} {campaign} {campaign.loaded.campaign.ephemeris.name} {campaign.loaded.rows.source}"
    assert tempfile.gettempdir() not in told
    assert "ephemeris.csv" in told
