"""CCSDS OEM and AEM: values by hand from the standards' definitions, and other packages as oracles."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from starplumb.io.formats.ccsds import (
    AttitudeTable,
    EphemerisTable,
    read_aem,
    read_oem,
    write_aem_kvn,
    write_aem_xml,
    write_oem_kvn,
    write_oem_xml,
)
from starplumb.physics.errors import InputError

S = 1_000_000_000

OEM_META = {
    "OBJECT_NAME": "SAT",
    "OBJECT_ID": "2026-001A",
    "CENTER_NAME": "EARTH",
    "REF_FRAME": "ITRF2014",
    "TIME_SYSTEM": "GPS",
    "START_TIME": "2000-01-01T12:00:00",
    "STOP_TIME": "2000-01-01T12:00:20",
}
OEM_ROWS = [
    "2000-01-01T12:00:00 7000.123456789 -1.5 0.25 0.001 -7.5 1.25",
    "2000-01-01T12:00:10.000000001 6999.0 -76.5 12.75 -0.5 -7.25 1.5",
    "2000-001T12:00:20 6990.0 -150.0 25.0 -1.0 -7.0 1.75",
]
AEM_META = {
    "OBJECT_NAME": "SAT",
    "OBJECT_ID": "2026-001A",
    "CENTER_NAME": "EARTH",
    "REF_FRAME_A": "EME2000",
    "REF_FRAME_B": "SC_BODY_1",
    "TIME_SYSTEM": "TAI",
    "START_TIME": "2000-01-01T12:00:00",
    "STOP_TIME": "2000-01-01T12:00:02",
    "ATTITUDE_TYPE": "QUATERNION",
}
V1 = {"ATTITUDE_DIR": "A2B", "QUATERNION_TYPE": "LAST"}
# Frame B is frame A turned by +90 deg about z. The coordinates of A's x axis in B are then (0, -1, 0):
# M_BA = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]. CCSDS writes the turn itself: Q = (0, 0, sin 45 deg, cos 45 deg).
Q_TURN_Z = "0 0 0.70710678118654752 0.70710678118654752"
M_BA = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def _block(meta: dict[str, str]) -> list[str]:
    return ["META_START", *(f"{key} = {value}" for key, value in meta.items()), "META_STOP"]


def oem_kvn(meta: dict[str, str] | None = None, rows: list[str] | None = None, version: str = "2.0") -> str:
    head = [f"CCSDS_OEM_VERS = {version}", "CREATION_DATE = 2026-01-01T00:00:00", "ORIGINATOR = TEST"]
    return "\n".join([*head, *_block(meta or OEM_META), *(OEM_ROWS if rows is None else rows)]) + "\n"


def aem_kvn(meta: dict[str, str] | None = None, rows: list[str] | None = None, version: str = "2.0") -> str:
    head = [f"CCSDS_AEM_VERS = {version}", "CREATION_DATE = 2026-01-01T00:00:00", "ORIGINATOR = TEST"]
    rows = [f"2000-01-01T12:00:00 {Q_TURN_Z}"] if rows is None else rows
    return "\n".join([*head, *_block(meta or AEM_META), "DATA_START", *rows, "DATA_STOP"]) + "\n"


def _xml(root: str, version: str, meta: dict[str, str], records: str) -> str:
    leaves = "".join(f"<{key}>{value}</{key}>\n" for key, value in meta.items())
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<{root} id="CCSDS_{root.upper()}_VERS" version="{version}">\n'
        "<header><COMMENT>c</COMMENT><CREATION_DATE>2026-01-01T00:00:00</CREATION_DATE>"
        "<ORIGINATOR>TEST</ORIGINATOR></header>\n"
        f"<body><segment><metadata><COMMENT>one</COMMENT><COMMENT>two</COMMENT>\n{leaves}</metadata>\n"
        f"<data><COMMENT>c</COMMENT>\n{records}</data></segment></body></{root}>\n"
    )


OEM_RECORD = (
    "<stateVector>\n<EPOCH>2000-01-01T12:00:00</EPOCH>"
    '<X units="km">7000.123456789</X><Y>-1.5</Y><Z>0.25</Z>\n'
    "<X_DOT>0.001</X_DOT><Y_DOT>-7.5</Y_DOT><Z_DOT>1.25</Z_DOT><X_DDOT>9</X_DDOT></stateVector>\n"
)


def oem_xml(records: str = OEM_RECORD, meta: dict[str, str] | None = None) -> str:
    return _xml("oem", "2.0", meta or OEM_META, records)


def aem_xml(state: str, version: str = "2.0", meta: dict[str, str] | None = None) -> str:
    epoch = "<EPOCH>2000-01-01T12:00:00</EPOCH>"
    # Named elements in an order of their own: names decide, not places.
    quaternion = (
        "<quaternion><QC>0.70710678118654752</QC><Q3>0.70710678118654752</Q3><Q2>0</Q2><Q1>0</Q1></quaternion>"
        "<quaternionDot><QC_DOT>5</QC_DOT><Q1_DOT>6</Q1_DOT><Q2_DOT>7</Q2_DOT><Q3_DOT>8</Q3_DOT></quaternionDot>"
        "<angVel><ANGVEL_X>1</ANGVEL_X><ANGVEL_Y>2</ANGVEL_Y><ANGVEL_Z>3</ANGVEL_Z></angVel>"
    )
    return _xml(
        "aem",
        version,
        meta or AEM_META,
        f"<attitudeState><{state}>{epoch}{quaternion}</{state}></attitudeState>\n",
    )


@pytest.fixture
def put(tmp_path: Path):
    """Writes a text or bytes to a file with a name that says nothing."""

    def write(content: str | bytes, name: str = "input.dat") -> Path:
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def C(q_xyzw):
    return Rotation.from_quat(q_xyzw).as_matrix()


# Orbit


def test_oem_reads_kilometres_as_metres_and_gps_time(put):
    table = read_oem(put(oem_kvn()))
    # GPS - TAI is -19 s: noon GPS is 19 s after noon TAI.
    assert table.t_ns.tolist() == [19 * S, 29 * S + 1, 39 * S]
    assert table.r[0].tolist() == [7000123.456789, -1500.0, 250.0]
    assert table.v is not None
    assert table.v[1].tolist() == [-500.0, -7250.0, 1500.0]
    assert (table.frame, table.frame_text, table.time_scale) == ("ITRF", "ITRF2014", "GPS")
    assert (table.object_name, table.object_id, table.segments) == ("SAT", "2026-001A", ((0, 3),))
    assert table.notices == ()


@pytest.mark.parametrize(("scale", "noon_ns"), [("TAI", 0), ("UTC", 32 * S), ("TT", -32_184_000_000)])
def test_oem_time_systems(put, scale, noon_ns):
    assert read_oem(put(oem_kvn(OEM_META | {"TIME_SYSTEM": scale}))).t_ns[0] == noon_ns


@pytest.mark.parametrize(
    ("text", "frame"),
    [
        (name, "ITRF")
        for name in ("ITRF", "ITRF-97", "ITRF97", "ITRF2000", "ITRF-2008", "itrf2020", "WGS84", "WGS-84")
    ]
    + [(name, "GCRF") for name in ("GCRF", "EME2000", "J2000", "ICRF", "ICRF3")],
)
def test_oem_frames(put, text, frame):
    assert read_oem(put(oem_kvn(OEM_META | {"REF_FRAME": text}))).frame == frame


@pytest.mark.parametrize("frame", ["TEMEX", "TOD_MARS", "GRC", "TDR", "EFG", "ITRF20145", "XITRF"])
def test_oem_refuses_other_frames(put, frame):
    with pytest.raises(InputError, match=rf'input.dat, line 8: REF_FRAME is "{frame}", wanted ITRF'):
        read_oem(put(oem_kvn(OEM_META | {"REF_FRAME": frame})))


@pytest.mark.parametrize("version", ["1.0", "2.0", "3.0"])
def test_oem_versions_comments_anywhere_and_line_ends(put, version):
    text = oem_kvn(version=version).replace(
        "META_STOP", "COMMENT in the metadata\nMETA_STOP\n\nCOMMENT X = 3"
    )
    text = "\ufeffCOMMENT first\n" + text.replace(OEM_ROWS[1], "COMMENT among rows\n\n" + OEM_ROWS[1])
    plain = read_oem(put(oem_kvn()))
    for ends in ("\n", "\r\n", "\r"):
        table = read_oem(put(text.replace("\n", ends)))
        np.testing.assert_array_equal(table.r, plain.r)
        np.testing.assert_array_equal(table.t_ns, plain.t_ns)


def test_oem_skips_accelerations_and_covariances(put):
    rows = [OEM_ROWS[0] + " 1 2 3", OEM_ROWS[1], OEM_ROWS[2]]
    covariance = ["COVARIANCE_START", "EPOCH = 2000-01-01T12:00:00", "COV_REF_FRAME = RTN", "1.0", "2.0 3.0"]
    table = read_oem(put(oem_kvn(rows=[*rows, *covariance, "COVARIANCE_STOP"])))
    assert table.r.shape == (3, 3)
    assert table.r[0, 0] == 7000123.456789
    assert any("covariance is not read (1 found)" in notice for notice in table.notices)


def test_oem_useable_time_is_honoured_aloud(put):
    meta = OEM_META | {
        "USEABLE_START_TIME": "2000-01-01T12:00:05",
        "USEABLE_STOP_TIME": "2000-01-01T12:00:10.000000001",
    }
    table = read_oem(put(oem_kvn(meta)))
    assert table.t_ns.tolist() == [29 * S + 1]
    assert len(table.notices) == 1
    assert "line 4: 2 rows outside the useable time were left out" in table.notices[0]


def _second_segment(start: str) -> str:
    rows = [row.replace("2000-01-01T12:00:00", start).split() for row in OEM_ROWS[:1]]
    later = [*rows[0][:0], start[:17] + "59", *rows[0][1:]]
    return "\n".join([*_block(OEM_META), " ".join(rows[0]), " ".join(later)]) + "\n"


def test_oem_segments_in_order_of_time(put):
    table = read_oem(put(oem_kvn() + _second_segment("2000-01-01T11:58:00")))
    assert table.segments == ((0, 2), (2, 5))
    assert table.t_ns.tolist() == [-101 * S, -42 * S, 19 * S, 29 * S + 1, 39 * S]


def test_oem_touching_segments_lose_the_second_copy(put):
    table = read_oem(put(oem_kvn() + _second_segment("2000-01-01T12:00:20")))
    assert table.segments == ((0, 3), (3, 4))
    assert table.r[2, 0] == 6990e3
    assert any("its first row was left out" in notice for notice in table.notices)


def test_oem_overlapping_segments_are_refused(put):
    with pytest.raises(InputError, match=r"line 16: this segment overlaps in time the one of line 4"):
        read_oem(put(oem_kvn() + _second_segment("2000-01-01T12:00:15")))


def test_oem_xml_equals_kvn(put):
    covariance = "<covarianceMatrix><EPOCH>x</EPOCH><CX_X>1</CX_X></covarianceMatrix>"
    table = read_oem(put(oem_xml(OEM_RECORD + covariance)))
    assert table.t_ns.tolist() == [19 * S]
    assert table.r[0].tolist() == [7000123.456789, -1500.0, 250.0]
    assert table.v is not None
    assert table.v[0].tolist() == [1.0, -7500.0, 1250.0]
    assert any("covariance is not read" in notice for notice in table.notices)


@pytest.mark.parametrize("encoding", ["UTF-8", "UTF-16", "ISO-8859-1", "windows-1252"])
def test_xml_encodings(put, encoding):
    text = oem_xml(meta=OEM_META | {"OBJECT_NAME": "Pléiades"}).replace("UTF-8", encoding)
    assert read_oem(put(text.encode(encoding))).object_name == "Pléiades"


def test_xml_namespaces_prefixes_and_combined_messages(put):
    text = (
        oem_xml().replace("<oem ", '<n:oem xmlns:n="urn:ccsds:schema:ndmxml" ').replace("</oem>", "</n:oem>")
    )
    assert read_oem(put(text)).frame == "ITRF"
    head, body = oem_xml().split("?>\n")
    other = '<opm id="CCSDS_OPM_VERS" version="2.0"><body><segment><metadata/></segment></body></opm>'
    assert read_oem(put(f"{head}?>\n<ndm>{other}{body}</ndm>")).frame == "ITRF"
    with pytest.raises(InputError, match="second oem"):
        read_oem(put(f"{head}?>\n<ndm>{body}{body}</ndm>"))


BOMB = '<!DOCTYPE oem [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]>\n<oem>'


@pytest.mark.parametrize("encoding", ["UTF-8", "UTF-16"])
def test_xml_entities_are_refused_unexpanded(put, encoding):
    text = oem_xml().replace("<oem", BOMB.replace("<oem>", "<oem"), 1).replace("UTF-8", encoding)
    with pytest.raises(InputError, match="line 2: found a DOCTYPE"):
        read_oem(put(text.encode(encoding)))


def _without(meta: dict[str, str], key: str) -> dict[str, str]:
    return {name: value for name, value in meta.items() if name != key}


BAD_OEM = {
    "empty": ("", "empty"),
    "other text": ("time,x_m\n1,2\n", 'line 1: found "time,x_m"'),
    "an AEM": (aem_kvn(), "line 1: found CCSDS_AEM_VERS, wanted CCSDS_OEM_VERS"),
    "version 4": (oem_kvn(version="4.0"), r'line 1: CCSDS_OEM_VERS is "4.0", wanted one of 1.0, 2.0, 3.0'),
    "no segment": ("CCSDS_OEM_VERS = 2.0\n", "no segment"),
    "no rows": (oem_kvn(rows=[]), "line 4: the segment that starts here has no data"),
    "metadata not closed": (oem_kvn().replace("META_STOP\n", ""), 'line 12: found "2000-01-01T12:00:00'),
    "breaks off": (oem_kvn().split("META_STOP")[0], "breaks off in the metadata"),
    "covariance not closed": (oem_kvn() + "COVARIANCE_START\n1.0\n", "breaks off in a covariance"),
    "stray mark": (oem_kvn() + "DATA_STOP\n", "line 16: found DATA_STOP in the data"),
    "keyword twice": (
        oem_kvn().replace("META_STOP", "REF_FRAME = J2000\nMETA_STOP"),
        "REF_FRAME a second time",
    ),
    "keyword without value": (
        oem_kvn(OEM_META | {"OBJECT_ID": ""}),
        "line 6: found OBJECT_ID without a value",
    ),
    "keyword among rows": (oem_kvn() + "X = 3\n", 'line 16: found "X = 3" among the data'),
    "Mars": (oem_kvn(OEM_META | {"CENTER_NAME": "MARS"}), 'line 7: CENTER_NAME is "MARS", wanted EARTH'),
    "time system": (
        oem_kvn(OEM_META | {"TIME_SYSTEM": "TDB"}),
        'line 9: TIME_SYSTEM is "TDB", wanted one of UTC, TAI',
    ),
    "not a number": (
        oem_kvn(rows=[OEM_ROWS[0], OEM_ROWS[1].replace("-76.5", "abc")]),
        'line 14: found "abc"',
    ),
    "thousands": (oem_kvn(rows=[OEM_ROWS[0].replace("7000", "7_000")]), 'line 13: found "7_000.12'),
    "nan": (
        oem_kvn(rows=[OEM_ROWS[0].replace("0.25", "nan")]),
        "line 13: found .*nan.*, wanted a finite number",
    ),
    "infinite": (oem_kvn(rows=[OEM_ROWS[0].replace("0.25", "1e999")]), "line 13: found .*finite number"),
    "short row": (
        oem_kvn(rows=[OEM_ROWS[0], OEM_ROWS[1][:-4]]),
        "line 14: found 5 numbers after the epoch, wanted 6 or 9",
    ),
    "bad epoch": (
        oem_kvn(rows=[OEM_ROWS[0], OEM_ROWS[1].replace("01T", "32T")]),
        "line 14: found '2000-01-32T",
    ),
    "repeated": (oem_kvn(rows=[OEM_ROWS[0], OEM_ROWS[0]]), "line 14: epoch 2000-01-01T12:00:00 repeats"),
    "unsorted": (
        oem_kvn(rows=[OEM_ROWS[1], OEM_ROWS[0]]),
        "line 14: epoch 2000-01-01T12:00:00 is earlier than",
    ),
    "useable never": (
        oem_kvn(OEM_META | {"USEABLE_START_TIME": "2001-01-01T00:00:00"}),
        "no row of the segment",
    ),
    "two objects": (
        oem_kvn() + _second_segment("2001-01-01T00:00:00").replace("SAT", "CAT"),
        'OBJECT_NAME is "CAT"',
    ),
    "digits of another script": (
        oem_kvn(rows=["2000-01-01T12:00:00 ٧000 0 0 0 0 0"]),
        'line 13: found "٧000", wanted a finite number',
    ),
    "two satellites of one name": (
        oem_kvn() + _second_segment("2001-01-01T00:00:00").replace("2026-001A", "2026-001B"),
        'OBJECT_ID is "2026-001B" but "2026-001A" in the first segment',
    ),
    "two frames": (
        oem_kvn() + _second_segment("2001-01-01T00:00:00").replace("ITRF2014", "GCRF"),
        "ITRF and in GCRF",
    ),
    "latin-1": (oem_kvn().replace("TEST", "Orbité").encode("latin-1"), "line 3: .*0xE9"),
    "binary": (b"\0\1\2\3" * 50, "UTF-8"),
    "broken XML": (oem_xml()[:-20], "line .*found XML that is not well formed"),
    "XML of another kind": (aem_xml("quaternionEphemeris"), "line 2: found the element aem, wanted oem"),
    "XML undecodable": (oem_xml(meta=OEM_META | {"OBJECT_NAME": "é"}).encode("latin-1"), "not well formed"),
    "XML encoding unknown": (oem_xml().replace("UTF-8", "KLINGON"), "XML"),
    "XML in metres": (oem_xml(OEM_RECORD.replace('"km"', '"m"')), 'line 15: X is in "m", wanted km'),
    "XML without Z": (oem_xml(OEM_RECORD.replace("<Z>0.25</Z>", "")), "line 14: this stateVector has no Z"),
    "XML Z twice": (oem_xml(OEM_RECORD.replace("<Z>", "<Z>1</Z><Z>")), "line 15: found Z a second time"),
    "XML empty Z": (oem_xml(OEM_RECORD.replace("0.25", " ")), "line 15: found Z without a value"),
    "XML no segment": ('<oem version="2.0"><body/></oem>', "no segment"),
    "XML no version": ("<oem><body/></oem>", 'CCSDS_OEM_VERS is ""'),
}
BAD_OEM |= {
    f"no {key}": (oem_kvn(_without(OEM_META, key)), f"line 4: .* lack the mandatory {key}")
    for key in OEM_META
}


@pytest.mark.parametrize("case", BAD_OEM)
def test_bad_oem(put, case):
    content, message = BAD_OEM[case]
    with pytest.raises(InputError, match=message) as caught:
        read_oem(put(content))
    assert "input.dat" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_absent_file_and_folder(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_oem(tmp_path / "none.oem")
    with pytest.raises(InputError, match="folder"):
        read_aem(tmp_path)


def test_unknown_keyword_is_said(put):
    table = read_oem(put(oem_kvn(OEM_META | {"USEABLE_START_TIM": "2000-01-01T12:00:05"})))
    assert any("keyword USEABLE_START_TIM is not known" in notice for notice in table.notices)


# Attitude


def test_aem_version_2_is_the_conjugate_of_ours(put):
    table = read_aem(put(aem_kvn()))
    np.testing.assert_allclose(C(table.q_BA_xyzw[0]), M_BA, atol=1e-15)
    assert table.t_ns.tolist() == [0]
    assert (table.frame_a, table.frame_b, table.time_scale) == ("EME2000", "SC_BODY_1", "TAI")


Q_GENERAL = np.array([0.1, 0.2, 0.3, np.sqrt(1 - 0.14)])


@pytest.mark.parametrize("direction", ["A2B", "B2A"])
@pytest.mark.parametrize("order", ["FIRST", "LAST"])
@pytest.mark.parametrize(
    ("kind", "extra"),
    [("QUATERNION", 0), ("QUATERNION/DERIVATIVE", 4), ("QUATERNION/RATE", 3)],
)
def test_aem_version_1_direction_and_order(put, direction, order, kind, extra):
    q = np.roll(Q_GENERAL, 1) if order == "FIRST" else Q_GENERAL
    row = " ".join(["2000-01-01T12:00:00", *map(repr, q.tolist()), *["0.5"] * extra])
    meta = AEM_META | {"ATTITUDE_DIR": direction, "QUATERNION_TYPE": order, "ATTITUDE_TYPE": kind}
    table = read_aem(put(aem_kvn(meta, [row], version="1.0")))
    # ADM annex F: the coordinate matrix of the direction the file names is R(Q) transposed.
    named = C(Q_GENERAL).T
    np.testing.assert_allclose(C(table.q_BA_xyzw[0]), named if direction == "A2B" else named.T, atol=1e-15)
    said = [notice for notice in table.notices if f"the type {kind} gives rates" in notice]
    assert len(said) == (0 if kind == "QUATERNION" else 1)


@pytest.mark.parametrize(("kind", "extra"), [("QUATERNION/DERIVATIVE", 4), ("QUATERNION/ANGVEL", 3)])
def test_aem_version_2_extra_columns(put, kind, extra):
    rows = [f"2000-01-01T12:00:00 {Q_TURN_Z}" + " 0.5" * extra]
    table = read_aem(put(aem_kvn(AEM_META | {"ATTITUDE_TYPE": kind}, rows)))
    np.testing.assert_allclose(C(table.q_BA_xyzw[0]), M_BA, atol=1e-15)


@pytest.mark.parametrize(
    ("version", "state"),
    [
        ("2.0", "quaternionEphemeris"),
        ("2.0", "quaternionDerivative"),
        ("2.0", "quaternionAngVel"),
        ("1.0", "quaternionState"),
        ("1.0", "quaternionDerivative"),
    ],
)
@pytest.mark.parametrize("order", ["FIRST", "LAST"])
def test_aem_xml_goes_by_the_names(put, version, state, order):
    meta = AEM_META | ({"ATTITUDE_DIR": "A2B", "QUATERNION_TYPE": order} if version == "1.0" else {})
    table = read_aem(put(aem_xml(state, version, meta)))
    np.testing.assert_allclose(C(table.q_BA_xyzw[0]), M_BA, atol=1e-15)


def test_aem_xml_version_1_direction(put):
    meta = AEM_META | {"ATTITUDE_DIR": "B2A"}
    table = read_aem(put(aem_xml("quaternionState", "1.0", meta)))
    np.testing.assert_allclose(C(table.q_BA_xyzw[0]), M_BA.T, atol=1e-15)


def test_aem_published_example(put):
    """Scalar first with derivatives and a useable time as a day of the year: public sample digits."""
    meta = (
        AEM_META
        | V1
        | {
            "QUATERNION_TYPE": "FIRST",
            "ATTITUDE_TYPE": "QUATERNION/DERIVATIVE",
            "TIME_SYSTEM": "UTC",
            "USEABLE_START_TIME": "2021-365T00:00:00.500",
        }
    )
    rows = [
        "2021-12-31T00:00:00.000  0.488615 -0.402157 0.581628 0.511111  3.00776e-4 2.59e-4 -2.83e-4 2.39e-4",
        "2021-12-31T00:00:00.500  0.488765 -0.402027 0.581486 0.511231  3.00715e-4 2.59e-4 -2.83e-4 2.39e-4",
    ]
    table = read_aem(put(aem_kvn(meta, rows, version="1.0")))
    assert table.t_ns.tolist() == [
        ((8035 * 86400 - 43200) + 37) * S + S // 2
    ]  # 8035 days since 2000, TAI-UTC 37 s
    np.testing.assert_allclose(table.q_BA_xyzw[0], [0.402027, -0.581486, -0.511231, 0.488765], atol=1e-6)


def test_aem_small_norm_errors_are_mended(put):
    table = read_aem(put(aem_kvn(rows=["2000-01-01T12:00:00 0 0 0.7075 0.7075"])))
    np.testing.assert_allclose(C(table.q_BA_xyzw[0]), M_BA, atol=1e-15)
    assert abs(np.linalg.norm(table.q_BA_xyzw[0]) - 1) < 1e-15


def _aem_meta(**changes: str) -> dict[str, str]:
    return AEM_META | changes


BAD_AEM = {
    "norm": (
        aem_kvn(rows=["2000-01-01T12:00:00 0 0 0.5 0.5"]),
        "line 16: the quaternion has norm 0.707107, wanted 1 within",
    ),
    "norm just too far": (aem_kvn(rows=["2000-01-01T12:00:00 0 0 0 1.0011"]), "norm 1.0011"),
    "zero": (aem_kvn(rows=["2000-01-01T12:00:00 0 0 0 0"]), "norm 0,"),
    "Euler angles": (
        aem_kvn(_aem_meta(ATTITUDE_TYPE="EULER_ANGLE")),
        'line 13: ATTITUDE_TYPE is "EULER_ANGLE", wanted',
    ),
    "spin": (aem_kvn(_aem_meta(ATTITUDE_TYPE="SPIN")), 'ATTITUDE_TYPE is "SPIN"'),
    "Euler angles in XML": (
        aem_xml("eulerAngle", meta=_aem_meta(ATTITUDE_TYPE="EULER_ANGLE")).replace("Q1>", "X1>"),
        'ATTITUDE_TYPE is "EULER_ANGLE", wanted QUATERNION',
    ),
    "no component in XML": (aem_xml("quaternionState").replace("Q1>", "X1>"), "this attitudeState has no Q1"),
    "columns": (
        aem_kvn(_aem_meta(ATTITUDE_TYPE="QUATERNION/ANGVEL")),
        "line 16: found 4 numbers .* wanted 7",
    ),
    "nan": (aem_kvn(rows=["2000-01-01T12:00:00 0 0 nan 1"]), "line 16: found .*finite"),
    "no DATA_START": (
        aem_kvn().replace("DATA_START\n", ""),
        "line 15: found .* in the lines before DATA_START",
    ),
    "no DATA_STOP": (aem_kvn().replace("DATA_STOP\n", ""), "breaks off in the data"),
    "v1 no direction": (
        aem_kvn(_aem_meta(QUATERNION_TYPE="LAST"), version="1.0"),
        "lack ATTITUDE_DIR, wanted A2B or B2A",
    ),
    "v1 no order": (
        aem_kvn(_aem_meta(ATTITUDE_DIR="A2B"), version="1.0"),
        "lack QUATERNION_TYPE, wanted FIRST or LAST",
    ),
    "v1 wrong order": (
        aem_kvn(_aem_meta(**V1 | {"QUATERNION_TYPE": "MID"}), version="1.0"),
        'is "MID", wanted FIRST or',
    ),
    "v2 with direction": (
        aem_kvn(_aem_meta(ATTITUDE_DIR="B2A")),
        'ATTITUDE_DIR is "B2A", but version 2 has no such',
    ),
    "v2 with order": (
        aem_kvn(_aem_meta(QUATERNION_TYPE="FIRST")),
        'QUATERNION_TYPE is "FIRST", but version 2',
    ),
    "version 3": (aem_kvn(version="3.0"), 'CCSDS_AEM_VERS is "3.0", wanted one of 1.0, 2.0'),
    "XML of Euler angles": (
        aem_xml("eulerAngle").replace("<Q1>0</Q1>", ""),
        "line 16: this attitudeState has no Q1",
    ),
}
BAD_AEM |= {
    f"no {key}": (aem_kvn(_without(AEM_META, key)), f"line 4: .* lack the mandatory {key}")
    for key in AEM_META
    if key != "CENTER_NAME"
}


@pytest.mark.parametrize("case", BAD_AEM)
def test_bad_aem(put, case):
    content, message = BAD_AEM[case]
    with pytest.raises(InputError, match=message) as caught:
        read_aem(put(content))
    assert "input.dat" in str(caught.value)


# Writers


def attitude(rng: np.random.Generator, n: int = 50) -> AttitudeTable:
    q = rng.normal(size=(n, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    q[0] = [1e-17, 0.0, 0.0, 1.0]
    t_ns = 8 * 10**17 + np.cumsum(rng.integers(1, 10**9, n))
    return AttitudeTable(t_ns, q, "EME2000", "SC_BODY_1", "UTC", "R&D <SAT>", ((0, 20), (20, n)), "2026-001A")


def ephemeris(rng: np.random.Generator, n: int = 50) -> EphemerisTable:
    t_ns = 8 * 10**17 + np.cumsum(rng.integers(1, 10**10, n))
    r, v = rng.normal(size=(n, 3)) * 4e6, rng.normal(size=(n, 3)) * 4e3
    return EphemerisTable(t_ns, r, v, "ITRF", "GPS", "R&D <SAT>", ((0, 20), (20, n)), "ITRF-97", "2026-001A")


@pytest.mark.parametrize("write", [write_aem_kvn, write_aem_xml])
def test_aem_reads_back_bit_for_bit(tmp_path, rng, write):
    table = attitude(rng)
    write(tmp_path / "out", table)
    back = read_aem(tmp_path / "out")
    np.testing.assert_array_equal(back.t_ns, table.t_ns)
    np.testing.assert_array_equal(back.q_BA_xyzw, table.q_BA_xyzw)
    assert (back.segments, back.object_name, back.frame_a) == (table.segments, table.object_name, "EME2000")


@pytest.mark.parametrize("write", [write_oem_kvn, write_oem_xml])
def test_oem_reads_back_bit_for_bit(tmp_path, rng, write):
    table = ephemeris(rng)
    write(tmp_path / "out", table)
    back = read_oem(tmp_path / "out")
    np.testing.assert_array_equal(back.t_ns, table.t_ns)
    np.testing.assert_array_equal(back.r, table.r)
    np.testing.assert_array_equal(back.v, table.v)
    assert (back.segments, back.object_name, back.frame_text) == (
        table.segments,
        table.object_name,
        "ITRF-97",
    )


def test_aem_kvn_is_written_in_the_standards_own_sense(tmp_path):
    q = Rotation.from_matrix(M_BA).as_quat(canonical=True)
    table = AttitudeTable(np.array([0, S]), np.array([q, q]), "EME2000", "SC_BODY_1", "TAI", "SAT", ((0, 2),))
    write_aem_kvn(tmp_path / "out", table, originator="ME", created="2026-01-01T00:00:00")
    assert (tmp_path / "out").read_text().split("\n") == [
        "CCSDS_AEM_VERS = 2.0",
        "CREATION_DATE = 2026-01-01T00:00:00",
        "ORIGINATOR = ME",
        "",
        "META_START",
        "OBJECT_NAME = SAT",
        "OBJECT_ID = SAT",
        "REF_FRAME_A = EME2000",
        "REF_FRAME_B = SC_BODY_1",
        "TIME_SYSTEM = TAI",
        "START_TIME = 2000-01-01T12:00:00.000000000",
        "STOP_TIME = 2000-01-01T12:00:01.000000000",
        "ATTITUDE_TYPE = QUATERNION",
        "META_STOP",
        "",
        "DATA_START",
        f"2000-01-01T12:00:00.000000000 {-q[0]:.1f} {-q[1]:.1f} {-q[2]!s} {q[3]!s}",
        f"2000-01-01T12:00:01.000000000 {-q[0]:.1f} {-q[1]:.1f} {-q[2]!s} {q[3]!s}",
        "DATA_STOP",
        "",
    ]
    assert -q[2] > 0.7  # +90 deg about z


def test_oem_needs_velocities_and_one_line_values(tmp_path, rng):
    table = ephemeris(rng)
    still = EphemerisTable(table.t_ns, table.r, None, "ITRF", "UTC", "S", table.segments)
    with pytest.raises(InputError, match="needs velocities"):
        write_oem_kvn(tmp_path / "out", still)
    with pytest.raises(InputError, match="ORIGINATOR would be"):
        write_oem_kvn(tmp_path / "out", table, originator="A\nMETA_START")
    assert not list(tmp_path.iterdir())


# Other packages


def _class(module, name):
    """ccsds-ndm-py shares its import name with another package: only the one with this class will do."""
    if not hasattr(module, name):
        pytest.skip("ccsds_ndm is another package than ccsds-ndm-py")
    return getattr(module, name)


@pytest.mark.parametrize("notation", ["kvn", "xml"])
def test_ccsds_ndm_py_agrees(tmp_path, rng, notation):
    module = pytest.importorskip("ccsds_ndm")
    oem, aem = ephemeris(rng), attitude(rng)
    {"kvn": write_oem_kvn, "xml": write_oem_xml}[notation](tmp_path / "o", oem)
    {"kvn": write_aem_kvn, "xml": write_aem_xml}[notation](tmp_path / "a", aem)
    theirs = _class(module, "Oem").from_file(str(tmp_path / "o")).segments
    states = np.concatenate([segment.data.state_vector_numpy for segment in theirs])
    np.testing.assert_allclose(states[:, :3] * 1e3, oem.r, rtol=1e-15)
    np.testing.assert_allclose(states[:, 3:6] * 1e3, oem.v, rtol=1e-15)
    attitudes = _class(module, "Aem").from_file(str(tmp_path / "a")).segments
    q = np.concatenate([segment.data.attitude_states_numpy for segment in attitudes])
    np.testing.assert_array_equal(q * [-1, -1, -1, 1], aem.q_BA_xyzw)


@pytest.mark.parametrize("notation", ["kvn", "xml"])
def test_what_ccsds_ndm_py_writes_is_read(tmp_path, rng, notation):
    module = pytest.importorskip("ccsds_ndm")
    oem, aem = ephemeris(rng), attitude(rng)
    write_oem_kvn(tmp_path / "o", oem)
    write_aem_kvn(tmp_path / "a", aem)
    _class(module, "Oem").from_file(str(tmp_path / "o")).to_file(str(tmp_path / "o2"), notation)
    _class(module, "Aem").from_file(str(tmp_path / "a")).to_file(str(tmp_path / "a2"), notation)
    np.testing.assert_allclose(read_oem(tmp_path / "o2").r, oem.r, rtol=1e-15)
    np.testing.assert_allclose(read_aem(tmp_path / "a2").q_BA_xyzw, aem.q_BA_xyzw, atol=1e-15)


def test_brahe_agrees(tmp_path, rng):
    brahe_ccsds = pytest.importorskip("brahe.ccsds")
    oem = ephemeris(rng)
    for write in (write_oem_kvn, write_oem_xml):
        write(tmp_path / "o", oem)
        segments = brahe_ccsds.OEM.from_file(str(tmp_path / "o")).segments
        r = [state.position for segment in segments for state in segment.states]
        np.testing.assert_allclose(r, oem.r, rtol=1e-15)


# Work


def test_the_work_grows_with_the_number_of_lines(tmp_path, rng):
    """Twice the lines, twice the calls of functions, ours and Python's, and few of them a line."""

    def calls(n):
        q = np.tile([0.5, 0.5, 0.5, 0.5], (n, 1))
        table = AttitudeTable(np.arange(n) * S, q, "EME2000", "SC_BODY_1", "TAI", "SAT", ((0, n),))
        write_aem_kvn(tmp_path / "out", table)
        counted = Counter()
        sys.setprofile(lambda frame, event, argument: counted.update([event]))
        try:
            read_aem(tmp_path / "out")
        finally:
            sys.setprofile(None)
        return counted["call"] + counted["c_call"]

    calls(10)  # what the first reading loads
    few, many = calls(1000), calls(2000)
    assert many - few < 1000 * 30
    assert calls(4000) - many < 2.1 * (many - few)
