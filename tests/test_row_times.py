"""Line scanners whose rows do not follow one another evenly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from helpers import write_good_campaign
from starplumb.io.campaign.marks.images import read_images
from starplumb.io.campaign.read import load_campaign
from starplumb.io.campaign.write import write_campaign
from starplumb.physics.errors import InputError
from starplumb.plan.demo import demo
from starplumb.table.appearance import Seen, appearance
from starplumb.table.geometry import locate, observe, project
from starplumb.table.row_times import RowTimes

S = 10**9


def test_times_by_hand():
    """Rows 0 to 10 at 1 ms, then 2 ms each; beyond the ends the outermost step goes on."""
    rows = RowTimes(np.array([0.0, 10.0, 20.0]), np.array([0, 10_000_000, 30_000_000]))
    np.testing.assert_array_equal(
        rows.late([-1.0, 0.0, 5.5, 10.0, 15.0, 21.0]), [-(10**6), 0, 5_500_000, 10**7, 2 * 10**7, 32 * 10**6]
    )
    np.testing.assert_allclose(rows.period_s([-1.0, 9.9, 10.0, 30.0]), [1e-3, 1e-3, 2e-3, 2e-3])
    assert rows.mean_period_s == 1.5e-3
    np.testing.assert_allclose(
        rows.row_at([-(10**6), 0, 5_500_000, 10**7, 2 * 10**7, 32 * 10**6]), [-1, 0, 5.5, 10, 15, 21]
    )
    back = RowTimes(rows.row, -rows.late_ns)
    np.testing.assert_allclose(back.period_s([0.0]), -1e-3)
    np.testing.assert_allclose(back.row_at([-5_500_000, -(2 * 10**7)]), [5.5, 15.0])
    with pytest.raises(ValueError, match="one way"):
        RowTimes(rows.row, np.array([0, 10, 5]))


def stretched(campaign, factor):
    """The same exposures with the rows after the middle counted ``factor`` times as densely, and how rows are counted
    then: row r of before is row ``count(r)``."""
    images = campaign.images
    last = campaign.camera.size_px[1] - 1.0
    half = 0.5 * last

    def count(row):
        return np.where(row <= half, row, half + factor * (row - half))

    before = np.array([0.0, half, last])
    tables = tuple(
        RowTimes(count(before), np.rint(S * period * before).astype(np.int64))
        for period in images.line_period_s
    )
    s = campaign.sightings
    moved = replace(s, row_px=count(s.row_px))
    camera = replace(campaign.camera, size_px=(campaign.camera.size_px[0], float(count(last)) + 1.0))
    uneven = replace(campaign, camera=camera, images=replace(images, row_times=tables), sightings=moved)
    return uneven, count


def test_exposures_and_geometry_are_those_of_the_rows_counted_otherwise():
    campaign, C_EK = demo("line-scan", 3, 8)
    uneven, count = stretched(campaign, 1.25)
    s = campaign.sightings
    shift = uneven.images.exposed(s.image, uneven.sightings.row_px) - campaign.images.exposed(
        s.image, s.row_px
    )
    assert np.abs(shift).max() <= 2, "nanoseconds"
    one, two = observe(campaign), observe(uneven)
    np.testing.assert_allclose(two.e_E, one.e_E, atol=1e-12)
    late = s.row_px > 0.5 * (campaign.camera.size_px[1] - 1.0)
    assert late.any()
    assert not late.all()
    np.testing.assert_allclose(
        two.line_period_s, np.where(late, one.line_period_s / 1.25, one.line_period_s), rtol=1e-9
    )
    np.testing.assert_allclose(
        two.row_rate_E, one.row_rate_E * (two.line_period_s / one.line_period_s)[:, None]
    )
    # the ground and back, across the bend
    image = np.zeros(5, dtype=np.int64)
    row = np.linspace(0.1, 0.9, 5) * campaign.camera.size_px[1]
    column = np.full(5, 100.0)
    p_J = locate(campaign, C_EK, image, column, row)
    pixel = project(uneven, C_EK, image, p_J)
    np.testing.assert_allclose(pixel, np.stack([column, count(row)], axis=-1), atol=2e-4)


def test_a_place_beyond_the_rows_of_the_table_is_beside_the_image():
    """Of five places along a column two lie in rows that the table, which ends in the middle, does not have."""
    campaign, C_EK = demo("line-scan", 2, 8)
    uneven, count = stretched(campaign, 1.25)
    image, row = np.zeros(5, dtype=np.int64), np.array([0.1, 0.3, 0.5, 0.7, 0.9]) * campaign.camera.size_px[1]
    p_J = locate(campaign, C_EK, image, np.full(5, 100.0), row)
    whole = appearance(uneven, C_EK, 0, p_J)
    np.testing.assert_allclose(whole.pixel[:, 1], count(row), atol=2e-4)
    assert (whole.seen == Seen.YES).all()
    table = uneven.images.row_times[0]
    short = RowTimes(np.append(table.row[:1], count(0.6 * campaign.camera.size_px[1])), table.late_ns[:2])
    cut = replace(uneven, images=replace(uneven.images, row_times=(short, uneven.images.row_times[1])))
    assert [Seen(s) for s in appearance(cut, C_EK, 0, p_J).seen][3:] == [Seen.BESIDE, Seen.BESIDE]


@pytest.mark.slow
def test_a_campaign_with_row_times_is_written_and_read_back(tmp_path):
    campaign, _ = demo("line-scan", 2, 8)
    uneven, _ = stretched(campaign, 0.8)
    path = write_campaign(tmp_path, uneven)
    assert "row_times" in (tmp_path / "images.csv").read_text().splitlines()[0]
    loaded = load_campaign(path)
    assert {"row_times_0.csv", "row_times_1.csv"} <= set(loaded.inputs)
    for found, wanted in zip(loaded.campaign.images.row_times, uneven.images.row_times, strict=True):
        np.testing.assert_array_equal(found.row, wanted.row)
        np.testing.assert_array_equal(found.late_ns, wanted.late_ns)
    s = uneven.sightings
    np.testing.assert_array_equal(
        loaded.campaign.images.exposed(s.image, s.row_px), uneven.images.exposed(s.image, s.row_px)
    )


def read(folder, rows, images="image_id,time,row_times\nIMG,2020-01-01T00:00:02,rows.csv\n"):
    """The images of a line scanner with the table ``rows``."""
    (folder / "images.csv").write_text(images)
    (folder / "rows.csv").write_text(rows)
    return read_images(folder / "images.csv", "UTC", True, [], folder=folder)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("row,time\n0,2020-01-01T00:00:02\n", r"rows\.csv: found 1 row, wanted at least two"),
        (
            "row,time\n0,2020-01-01T00:00:02\n0,2020-01-01T00:00:03\n",
            r"rows\.csv, row 3, column row: found 0",
        ),
        (
            "row,time\n0,2020-01-01T00:00:02\n1,2020-01-01T00:00:03\n2,2020-01-01T00:00:02.5\n",
            r"rows\.csv, row 4, column time: found .*wanted times that increase, or decrease",
        ),
        (
            "row,time\n0,2020-01-01T00:00:03\n10,2020-01-01T00:00:04\n",
            r"rows\.csv: found row 0 exposed 1 s after the time of the image",
        ),
        ("row\n0\n", r"rows\.csv.*wanted the column time"),
        (
            "row,time\n0,2020-01-01T00:00:02\n1e-300,2020-01-01T00:00:03\n",
            r"rows\.csv, row 3, column row: found 1e-300, wanted rows that increase",
        ),
        (
            "row,time\n0,2020-01-01T00:00:02\n1e20,2020-01-01T00:00:03\n",
            r"rows\.csv, row 3, column row: found 1e\+?20, wanted a row from",
        ),
    ],
)
def test_tables_of_rows_that_cannot_be_used(tmp_path, rows, message):
    with pytest.raises(InputError, match=message):
        read(tmp_path, rows)


def test_what_contradicts_a_table_of_rows_is_refused(tmp_path):
    rows = "row,time\n0,2020-01-01T00:00:02\n10,2020-01-01T00:00:03\n"
    stated = "image_id,time,row_times,line_period_s\nIMG,2020-01-01T00:00:02,rows.csv,{}\n"
    with pytest.raises(
        InputError, match=r"images\.csv, row 2, column line_period_s: found 0\.2, wanted the mean period"
    ):
        read(tmp_path, rows, stated.format(0.2))
    assert read(tmp_path, rows, stated.format(0.1)).period_s(np.array([0]), [5.0])[0] == 0.1
    with pytest.raises(InputError, match=r"images\.csv, row 2, column row_times: found .*no such file"):
        read(tmp_path, rows, stated.format(0.1).replace("rows.csv", "none.csv"))


@pytest.mark.slow
def test_a_mark_beyond_the_table_of_its_image_is_named(tmp_path):
    campaign, _ = demo("line-scan", 2, 8)
    uneven, _ = stretched(campaign, 0.8)
    path = write_campaign(tmp_path, uneven)
    text = (tmp_path / "row_times_0.csv").read_text().splitlines()
    (tmp_path / "row_times_0.csv").write_text("\n".join(text[:-1]) + "\n")
    with pytest.raises(
        InputError, match=r"observations\.csv, row \d+, column row_px: found .*wanted a row of row_times_0"
    ):
        load_campaign(path)


def test_a_frame_camera_has_none(tmp_path):
    path = write_good_campaign(tmp_path)
    text = (tmp_path / "images.csv").read_text().splitlines()
    rows = [text[0] + ",row_times", *(line + ",rows.csv" for line in text[1:])]
    (tmp_path / "images.csv").write_text("\n".join(rows) + "\n")
    loaded = load_campaign(path)
    assert loaded.campaign.images.row_times is None
    assert any("ignored the column row_times" in notice for notice in loaded.notices)
