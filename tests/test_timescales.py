"""Epochs: by hand, against ERFA, and what a user may get wrong."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import erfa
import numpy as np
import pytest

from starplumb.physics.errors import EpochError, InputError
from starplumb.physics.timescales import (
    SCALES,
    format_iso,
    leap_seconds,
    moment,
    parse,
    tt_julian,
    utc_midnight,
    utc_minus_tai,
)

SECOND = 1_000_000_000


def test_the_origin_is_zero_and_the_scales_differ_by_their_constants() -> None:
    assert parse(["2000-01-01T12:00:00"], "TAI")[0] == 0
    assert parse(["2000-01-01T11:59:41"], "GPS")[0] == 0
    assert parse(["2000-01-01T12:00:32.184"], "TT")[0] == 0
    assert parse(["2000-01-01T11:59:28"], "UTC")[0] == 0  # TAI - UTC was 32 s


def test_since_2017_gps_is_18_s_and_tai_37_s_ahead_of_utc() -> None:
    utc, gps, tai = (parse(["2026-06-01T00:00:00"], scale)[0] for scale in ("UTC", "GPS", "TAI"))
    assert utc - gps == 18 * SECOND
    assert utc - tai == 37 * SECOND
    assert utc_minus_tai(utc) == -37


def test_an_inserted_second_lasts_one_second() -> None:
    texts = ["2016-12-31T23:59:59", "2016-12-31T23:59:60", "2016-366T23:59:60.25Z", "2017-01-01T00:00:00"]
    t_ns = parse(texts, "UTC")
    assert (t_ns - t_ns[0]).tolist() == [0, SECOND, 1_250_000_000, 2 * SECOND]
    assert utc_minus_tai(t_ns).tolist() == [-36, -36, -36, -37]
    assert format_iso(t_ns, "UTC", 2) == [
        "2016-12-31T23:59:59.00",
        "2016-12-31T23:59:60.00",
        "2016-12-31T23:59:60.25",
        "2017-01-01T00:00:00.00",
    ]


@pytest.mark.parametrize("layout", ["%Y-%m-%dT%H:%M:%S.%f", "%Y-%m-%d %H:%M:%S.%fZ", "%Y-%jT%H:%M:%S.%f"])
def test_utc_agrees_with_erfa(layout: str, rng: np.random.Generator) -> None:
    start = datetime(2000, 1, 1, tzinfo=UTC)
    times = [start + timedelta(seconds=s) for s in rng.uniform(0, 27 * 365.25 * 86400, 500)]
    t_ns = parse([time.strftime(layout) for time in times], "UTC")
    parts = np.array([(t.year, t.month, t.day, t.hour, t.minute) for t in times]).T
    tai = erfa.utctai(*erfa.dtf2d("UTC", *parts, [t.second + t.microsecond * 1e-6 for t in times]))
    difference_s = ((tai[0] - 2451545.0) + tai[1]) * 86400 - t_ns * 1e-9
    assert np.abs(difference_s).max() < 2e-6  # a double of 1e4 days resolves 0.16 us


def test_tt_agrees_with_erfa_and_keeps_the_nanosecond() -> None:
    t_ns = parse(["2018-12-26T10:48:55.449000001", "1980-01-06T00:00:00"], "UTC")
    jd = tt_julian(t_ns)
    tt = erfa.taitt(
        *erfa.utctai(*erfa.dtf2d("UTC", [2018, 1980], [12, 1], [26, 6], [10, 0], [48, 0], [55.449, 0]))
    )
    np.testing.assert_allclose((jd[0] - tt[0]) + (jd[1] - tt[1]), 0.0, atol=2e-14)
    jd_before = tt_julian(t_ns[0] - 1)
    assert (jd[1][0] - jd_before[1]) * 86400e9 == pytest.approx(1.0, abs=0.02)
    assert ((jd[1] >= 0) & (jd[1] < 1)).all()


def test_decimals_round_to_the_nanosecond_and_carry() -> None:
    texts = [
        f"2017-01-01T00:00:00{d}"
        for d in ("", ".5", ".123456789", ".1234567894", ".1234567896", ".9999999999")
    ]
    t_ns = parse(texts, "TAI") - parse(["2017-01-01T00:00:00"], "TAI")
    assert t_ns.tolist() == [0, 500_000_000, 123_456_789, 123_456_789, 123_456_790, SECOND]


def test_layouts_may_be_mixed_in_one_table() -> None:
    texts = [" 2018-360T10:48:55.44900000000 ", "2018-12-26T10:48:55.449Z", "2018-12-26 10:48:55.449"]
    assert len(set(parse(texts, "UTC").tolist())) == 1
    assert parse([], "UTC").shape == (0,)


@pytest.mark.parametrize("scale", SCALES)
def test_text_and_epoch_are_inverse(scale: str, rng: np.random.Generator) -> None:
    t_ns = rng.integers(-800_000_000 * SECOND, 850_000_000 * SECOND, 1000)
    np.testing.assert_array_equal(parse(format_iso(t_ns, scale, 9), scale), t_ns)


def test_format_rounds_half_up_through_the_year() -> None:
    t_ns = parse(["2019-12-31T23:59:59.9995", "2019-12-31T23:59:59.9994"], "GPS")
    assert format_iso(t_ns, "GPS", 3) == ["2020-01-01T00:00:00.000", "2019-12-31T23:59:59.999"]
    assert format_iso(t_ns[0], "GPS", 0) == ["2020-01-01T00:00:00"]
    assert format_iso(parse(["2016-12-31T23:59:60.9999"], "UTC"), "UTC", 3) == ["2017-01-01T00:00:00.000"]
    assert format_iso(parse(["2016-12-31T23:59:59.9999"], "UTC"), "UTC", 3) == ["2016-12-31T23:59:60.000"]


def test_midnights_of_utc_follow_the_table_of_leap_seconds() -> None:
    table = leap_seconds()
    np.testing.assert_array_equal(table.t_ns, utc_midnight(table.mjd))
    np.testing.assert_array_equal(erfa.leap_seconds.get()["tai_utc"][-27:], table.tai_minus_utc[1:28])
    assert utc_midnight(57754) == parse(["2017-01-01T00:00:00"], "UTC")[0]
    assert np.diff(utc_midnight([57752, 57753, 57754])).tolist() == [86400 * SECOND, 86401 * SECOND]


@pytest.mark.parametrize(
    ("text", "scale", "message"),
    [
        ("", "UTC", "found no time, wanted an ISO 8601 time"),
        ("yesterday", "UTC", "found 'yesterday', wanted an ISO 8601 time"),
        ("2017-02-29T00:00:00", "UTC", "a date that exists"),
        ("2017-366T00:00:00", "UTC", "a date that exists"),
        ("2017-000T00:00:00", "UTC", "a date that exists"),
        ("2017-13-01T00:00:00", "UTC", "wanted an ISO 8601 time"),
        ("2017-01-01T24:00:00", "UTC", "wanted an ISO 8601 time"),
        ("2017-01-01T00:60:00", "UTC", "wanted an ISO 8601 time"),
        ("2017-01-01T00:00:61", "UTC", "wanted an ISO 8601 time"),
        ("2017-01-01T00:00:00.", "UTC", "wanted an ISO 8601 time"),
        ("2017-01-01T00:00:00,5", "UTC", "wanted an ISO 8601 time"),
        ("2017-01-01T00:00:00.5x", "UTC", "wanted an ISO 8601 time"),
        ("2017-01-01T00:00:00ZZ", "UTC", "wanted an ISO 8601 time"),
        ("2017-01-01T00:00:00\x00", "UTC", "wanted an ISO 8601 time"),
        ("2017-01-01T00:00:0\u0661", "UTC", "wanted an ISO 8601 time"),
        ("2017-01-01X00:00:00", "UTC", "wanted an ISO 8601 time"),
        ("2017-01-01T00:00:00." + 100 * "0", "UTC", "wanted an ISO 8601 time"),
        ("1545821335.449", "UTC", "wanted an ISO 8601 time"),
        ("9999-01-01T00:00:00", "TAI", "wanted an ISO 8601 time"),
        ("2017-01-01T00:00:00+02:00", "UTC", "with an offset from UTC, wanted"),
        ("2017-01-01T00:00:00.5-0500", "TAI", "with an offset from UTC, wanted"),
        ("2017-01-01T00:00:00Z", "GPS", "says UTC, wanted a time in GPS"),
        ("2015-12-31T23:59:60", "UTC", "UTC had no leap second then"),
        ("2016-12-31T22:59:60", "UTC", "UTC had no leap second then"),
        ("2016-12-31T23:59:60", "GPS", "GPS had no leap second then"),
        ("1971-12-31T23:59:59", "UTC", "found 1971-12-31 UTC, wanted an epoch within the leap-second table"),
        ("2200-01-01T00:00:00", "UTC", "found 2200-01-01 UTC, wanted an epoch within"),
    ],
)
def test_a_wrong_time_is_named_with_its_row(text: str, scale: str, message: str) -> None:
    with pytest.raises(EpochError, match=message) as caught:
        parse(["2017-01-01T00:00:00", "2017-180T00:00:00.25", text], scale)
    assert caught.value.row == 2


def test_an_unknown_scale_names_the_known_ones() -> None:
    with pytest.raises(InputError, match="'UT1' is unknown, wanted one of UTC, TAI, GPS, TT"):
        parse(["2017-01-01T00:00:00"], "UT1")
    with pytest.raises(InputError, match="wanted one of"):
        format_iso(0, "utc")


def test_utc_ends_where_the_table_expires() -> None:
    table = leap_seconds()
    last = table.expiry_t_ns - 1
    assert utc_minus_tai(last) == -table.tai_minus_utc[-1]
    assert parse(format_iso(last, "UTC", 9), "UTC") == last
    with pytest.raises(EpochError, match="within the leap-second table") as caught:
        utc_minus_tai([last, last + 1])
    assert caught.value.row == 1
    with pytest.raises(EpochError, match="1971-12-31T23:59:59 TAI"):
        utc_minus_tai(parse(["1971-12-31T23:59:59"], "TAI"))
    with pytest.raises(EpochError, match="within the leap-second table"):
        utc_midnight(table.expiry_mjd)


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("2026-05-01", "2026-05-01T00:00:00"),
        ("2026-121", "2026-05-01T00:00:00"),
        (" 2026-05-01T06:00:00Z", "2026-05-01T06:00:00"),
    ],
)
def test_a_day_that_a_person_writes_is_its_midnight(text, same):
    assert moment(text, "UTC") == parse([same], "UTC")[0]
    for wrong in ("2026-13-01", "2026-05", "20260501", "2026-05-01T06"):
        with pytest.raises(EpochError, match="wanted an ISO 8601 time"):
            moment(wrong, "UTC")
