"""Tables in the odd shapes that programs leave behind, and files of ground points in place of tables."""

from __future__ import annotations

import unicodedata

import numpy as np
import pytest

from helpers import CAMPAIGN, FILES, write_good_campaign
from starplumb.io.campaign.read import load_campaign
from starplumb.physics.errors import EpochError, InputError
from starplumb.physics.timescales import parse


def test_an_offset_of_nothing_is_a_z():
    found = parse(["2026-03-20T09:58:56.25+00:00", "2026-03-20T09:58:56.25Z"], "UTC")
    assert found[0] == found[1]


@pytest.mark.parametrize(
    ("text", "scale"),
    [
        ("2026-03-20T09:58:56+00:00", "GPS"),
        ("2026-03-20T09:58:56+01:00", "UTC"),
        ("2026-03-20T09:58:56-00:00", "UTC"),
        ("2026-03-20T09:58:56+00:00Z", "UTC"),
    ],
)
def test_other_offsets_are_refused_with_the_text_as_written(text, scale):
    with pytest.raises(EpochError) as refused:
        parse(["2026-03-20T09:58:56", text], scale)
    assert refused.value.row == 1
    assert text in str(refused.value)


EMPTY = {"commas": ",,,,\n" * 3, "blanks": " , , ,,\n,,,,\n\n", "many": ",,,,\n" * 3000}


@pytest.mark.parametrize("name", EMPTY)
def test_empty_rows_at_the_end_are_passed_over(tmp_path, name):
    plain = load_campaign(write_good_campaign(tmp_path / "plain"))
    text = FILES["observations.csv"] + EMPTY[name]
    found = load_campaign(write_good_campaign(tmp_path / "own", observations=text))
    np.testing.assert_array_equal(found.campaign.sightings.column_px, plain.campaign.sightings.column_px)
    assert found.notices == plain.notices


def test_an_empty_row_with_others_below_it_is_refused(tmp_path):
    header, first, rest = FILES["observations.csv"].split("\n", 2)
    for gap, row in ((",,,,\n", 3), (",,,,\n" * 2000, 3)):
        path = write_good_campaign(tmp_path, observations=f"{header}\n{first}\n{gap}{rest}")
        with pytest.raises(
            InputError, match=f"observations.csv, row {row}, column column_px: found an empty"
        ):
            load_campaign(path)


def test_a_table_of_empty_rows_has_none(tmp_path):
    with pytest.raises(InputError, match=r"images.csv: found a header without rows below it"):
        load_campaign(write_good_campaign(tmp_path, images="image_id,time\n,\n"))


def test_a_campaign_without_marks_is_read_but_not_calibrated(tmp_path):
    headers = {name: FILES[f"{name}.csv"].split()[0] + "\n" for name in ("landmarks", "observations")}
    loaded = load_campaign(write_good_campaign(tmp_path, **headers))
    assert loaded.campaign.sightings.image.size == len(loaded.campaign.landmarks.ids) == 0
    with pytest.raises(InputError, match=r"observations.csv: found no rows yet, wanted at least one"):
        loaded.coverage.require()
    with pytest.raises(InputError, match=r"landmarks.csv: found it without rows beside 5 observations"):
        load_campaign(write_good_campaign(tmp_path, landmarks=headers["landmarks"]))


def frame(text: str) -> dict[str, list[object]]:
    """The columns of a CSV text, numbers as numbers."""
    header, *rows = (line.split(",") for line in text.split())
    columns = zip(*rows, strict=True)
    return {
        name: [cell if name.endswith("_id") else float(cell) for cell in cells]
        for name, cells in zip(header, columns, strict=True)
    }


@pytest.mark.parametrize("nothing", [None, float("nan")])
def test_so_they_are_in_data_frames(tmp_path, nothing):
    pytest.importorskip("pyarrow")
    path = write_good_campaign(tmp_path)
    plain = load_campaign(path)
    columns = {
        name: [*cells, None if name.endswith("_id") else nothing, None]
        for name, cells in frame(FILES["observations.csv"]).items()
    }
    found = load_campaign(path, {"observations": columns})
    np.testing.assert_array_equal(found.campaign.sightings.row_px, plain.campaign.sightings.row_px)


def test_so_they_are_where_a_frame_keeps_nan_and_null_apart(tmp_path):
    pa = pytest.importorskip("pyarrow")
    path = write_good_campaign(tmp_path)
    columns = frame(FILES["observations.csv"])
    table = pa.table(
        {name: [*cells, None if name.endswith("_id") else float("nan")] for name, cells in columns.items()}
    )
    found = load_campaign(path, {"observations": table})
    assert found.campaign.sightings.image.size == len(columns["row_px"])


NAME = "T\u00e9n\u00e9r\u00e9 L1"


@pytest.mark.parametrize("as_frame", [False, True])
def test_one_name_in_two_spellings_of_unicode_is_one(tmp_path, as_frame):
    apart = unicodedata.normalize("NFD", NAME)
    assert apart != NAME
    landmarks, observations = (
        FILES[f"{name}.csv"].replace("L1", spelt)
        for name, spelt in (("landmarks", NAME), ("observations", apart))
    )
    path = write_good_campaign(tmp_path, landmarks=landmarks, observations=observations)
    tables = None
    if as_frame:
        pytest.importorskip("pyarrow")
        columns = frame(FILES["observations.csv"])
        columns["landmark_id"] = [str(name).replace("L1", apart) for name in columns["landmark_id"]]
        tables = {"observations": columns}
    assert NAME in load_campaign(path, tables).campaign.landmarks.ids


@pytest.mark.parametrize("as_frame", [False, True])
def test_zeros_that_a_program_has_taken_off_an_id_are_hinted_at(tmp_path, as_frame):
    landmarks, observations = (FILES[f"{name}.csv"] for name in ("landmarks", "observations"))
    for i in (1, 2, 3):
        landmarks = landmarks.replace(f"L{i},", f"00{i},")
        observations = observations.replace(f"L{i},", f"{i},")
    path = write_good_campaign(tmp_path, landmarks=landmarks, observations=observations)
    tables = None
    if as_frame:
        pytest.importorskip("pyarrow")
        columns = frame(observations)
        columns["landmark_id"] = [int(str(name)) for name in columns["landmark_id"]]
        tables = {"observations": columns}
    with pytest.raises(InputError) as refused:
        load_campaign(path, tables)
    row = 0 if as_frame else 2
    assert f', row {row}, column landmark_id: found "1", wanted one of' in str(refused.value)
    assert '(perhaps "001", with zeros before it: have the column read as text)' in str(refused.value)


# Sigmas stated beside a table, and files of ground points -----------------------------------------------------


def test_a_sigma_may_stand_in_the_section(tmp_path):
    header, *rows = FILES["observations.csv"].split()
    bare = "\n".join(line.rsplit(",", 1)[0] for line in (header, *rows))
    toml = CAMPAIGN.replace('file = "observations.csv"', 'file = "observations.csv"\nsigma_px = 0.25')
    found = load_campaign(write_good_campaign(tmp_path, campaign=toml, observations=bare))
    np.testing.assert_array_equal(found.campaign.sightings.sigma_px, np.full(len(rows), 0.25))
    with pytest.raises(
        InputError, match=r"found the column sigma_px beside observations.sigma_px, wanted only"
    ):
        load_campaign(write_good_campaign(tmp_path, campaign=toml))
    with pytest.raises(InputError, match="wanted the column sigma_px too"):
        load_campaign(write_good_campaign(tmp_path, observations=bare))


POINTS = """\
# WGS84
11\t0.0\t0.0\t100.0\t2\t2\t2\tI1.tif\t5999.5\t5999.5\t0.3\t0.3\tI2.tif\t5990\t6001\t0.3\t0.3
"""
MORE = "12\t0.01\t0.02\t50.0\t2\t2\t2\tI2.tif\t5000\t4000\t0.3\t0.3\n"


def with_points(folder, observations: str, landmarks: str = 'file = "*.gcp"', origin: str = "center"):
    toml = CAMPAIGN.replace('file = "observations.csv"', observations)
    toml = toml.replace('file = "landmarks.csv"', landmarks)
    toml = toml.replace("[mounting]", f'pixel_origin = "{origin}"\n\n[mounting]')
    path = write_good_campaign(folder, campaign=toml)
    (folder / "a.gcp").write_text(POINTS)
    (folder / "b.gcp").write_text(MORE)
    return path


@pytest.mark.parametrize("origin", ["center", "corner"])
@pytest.mark.parametrize("files", ['"*.gcp"', '["a.gcp", "b.gcp"]'])
def test_ground_points_are_landmarks_and_observations(tmp_path, files, origin):
    """Pixels of such files count from the centre of the first, whatever the campaign says of its own."""
    found = load_campaign(with_points(tmp_path, f"file = {files}", origin=origin))
    c = found.campaign
    assert c.landmarks.ids == ("11", "12")
    np.testing.assert_allclose(c.landmarks.r_J[0], [6378237.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(np.diagonal(c.landmarks.covariance_J[0]), 4.0)
    assert [c.images.ids[i] for i in c.sightings.image] == ["I1", "I2", "I2"]
    np.testing.assert_array_equal(c.sightings.column_px, [5999.5, 5990.0, 5000.0])
    np.testing.assert_array_equal(c.sightings.row_px, [5999.5, 6001.0, 4000.0])
    np.testing.assert_array_equal(c.sightings.sigma_px, 0.3)
    assert {"a.gcp", "b.gcp"} < set(found.inputs)


@pytest.mark.parametrize(
    ("observations", "says"),
    [
        ('file = "*.points"', 'found no file that fits "*.points", wanted at least one'),
        ('file = ["a.gcp", "c.gcp"]', "observations.file: "),
        ('file = "*.gcp"\nsigma_px = 0.5', "found the column sigma_px beside observations.sigma_px"),
        (
            'file = ["a.gcp", "b.csv"]',
            'observations.file: found "b.csv", wanted a file name ending in .points',
        ),
        ('file = ["a.gcp"]\nkeep = { u = 1 }', "observations.keep: found beside a file that is no table"),
        ("file = []", "observations.file: found [], wanted"),
    ],
)
def test_what_is_wrong_with_ground_points_is_said(tmp_path, observations, says):
    with pytest.raises(InputError) as refused:
        load_campaign(with_points(tmp_path, observations))
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_geojson_of_both_is_read_as_it_comes(shared_cases, tmp_path):
    """Its one place is 33.6 deg south, its pixel (821.3, 62.3) of an image that is named without the ending."""
    pytest.importorskip("pyproj", reason="needs the extra gis")
    stated = 'file = "gcps.geojson"\nsigma_m = 0.5'
    path = with_points(tmp_path, 'file = "gcps.geojson"\nsigma_px = 0.4', stated)
    (tmp_path / "gcps.geojson").write_text((shared_cases / "geojson" / "gcps.geojson").read_text())
    (tmp_path / "images.csv").write_text("image_id,time\nscene,2020-01-01T00:00:01.500\n")
    c = load_campaign(path).campaign
    assert (c.landmarks.ids, c.images.ids) == (("plinth-1",), ("scene",))
    np.testing.assert_allclose([c.sightings.column_px[0], c.sightings.row_px[0]], [821.3, 62.3])
    assert c.landmarks.r_J[0, 2] < 0.0
    np.testing.assert_allclose(np.diagonal(c.landmarks.covariance_J[0]), 0.25)


def test_a_point_of_an_unknown_image_is_named_with_its_file(tmp_path):
    path = with_points(tmp_path, 'file = "*.gcp"')
    (tmp_path / "b.gcp").write_text(MORE.replace("I2", "I9"))
    with pytest.raises(
        InputError, match=r'b\.gcp, point 12, column image_id: found "I9", wanted one of the 2'
    ):
        load_campaign(path)


# Separators, decimal commas, and what is no table --------------------------------------------------------------


@pytest.mark.parametrize("separator", [";", "\t", "|"])
@pytest.mark.parametrize("decimal", [".", ","])
def test_other_separators_and_decimal_commas_are_declared(tmp_path, separator, decimal):
    """Times too: the seconds have a comma."""
    plain = load_campaign(write_good_campaign(tmp_path / "plain")).campaign
    toml, files = CAMPAIGN, {}
    written = separator.replace("\t", "\\t")
    for name in ("ephemeris", "attitude", "landmarks", "images", "observations"):
        stated = f'file = "{name}.csv"\nseparator = "{written}"\ndecimal = "{decimal}"'
        toml = toml.replace(f'file = "{name}.csv"', stated)
        files[name] = FILES[f"{name}.csv"].replace(",", separator).replace(".", decimal)
    found = load_campaign(write_good_campaign(tmp_path / "own", campaign=toml, **files)).campaign
    np.testing.assert_array_equal(found.attitude.t_ns, plain.attitude.t_ns)
    np.testing.assert_array_equal(found.images.t_ns, plain.images.t_ns)
    np.testing.assert_array_equal(found.ephemeris.r_J, plain.ephemeris.r_J)
    np.testing.assert_array_equal(found.landmarks.r_J, plain.landmarks.r_J)
    np.testing.assert_array_equal(found.sightings.row_px, plain.sightings.row_px)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("semicolons", 'found columns separated by semicolons, wanted commas (or separator = ";" stated'),
        ("tabs", 'found columns separated by tabs, wanted commas (or separator = "\\t" stated'),
        ("bars", 'found columns separated by bars, wanted commas (or separator = "|" stated'),
        ("workbook", "found a workbook of Excel or another zip file, wanted its sheet saved as CSV"),
    ],
)
def test_what_is_separated_otherwise_or_no_table_is_told_what_to_do(tmp_path, text, says):
    path = write_good_campaign(tmp_path)
    marks = {"semicolons": ";", "tabs": "\t", "bars": "|"}
    table = tmp_path / "observations.csv"
    if text in marks:
        table.write_text(FILES["observations.csv"].replace(",", marks[text]))
    else:
        table.write_bytes(b"PK\x03\x04" + bytes(range(30)))
    with pytest.raises(InputError) as refused:
        load_campaign(path)
    assert says in str(refused.value)
    assert str(refused.value).isprintable()


def test_a_count_in_a_column_of_times_is_told_how_it_is_declared(tmp_path):
    images = FILES["images.csv"].replace("2020-01-01T00:00:01.500", "1577836801.5")
    with pytest.raises(
        InputError, match=r"row 2, column time: .* a count is declared, as in time = \{ column"
    ):
        load_campaign(write_good_campaign(tmp_path, images=images))


@pytest.mark.parametrize(
    ("key", "says"),
    [
        ('separator = " "', 'observations.separator: found " ", wanted ",", ";", "\\t" or "|"'),
        ('decimal = ";"', 'observations.decimal: found ";", wanted "." or ","'),
    ],
)
def test_separators_are_a_few(tmp_path, key, says):
    toml = CAMPAIGN.replace('file = "observations.csv"', f'file = "observations.csv"\n{key}')
    with pytest.raises(InputError) as refused:
        load_campaign(write_good_campaign(tmp_path, campaign=toml))
    assert says in str(refused.value)
