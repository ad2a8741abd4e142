"""Files of orbit and attitude are known by their first lines, whatever their names, packed or not."""

from __future__ import annotations

import base64
import gzip
from pathlib import Path

import numpy as np
import pytest

from bad_cases import AEM, OEM, both, put, swap
from helpers import write_good_campaign
from starplumb.io.campaign.read import load_campaign
from starplumb.io.formats.registry import ATTITUDES, ORBITS, recognised
from starplumb.io.text.packed import unpacked
from starplumb.physics.errors import InputError
from test_sp3 import sp3

TOML = "campaign.toml"
COMPRESSED = base64.b85decode(
    "ADxg;U<eebAmEK0F>(}~5yQp}8wGE~kRh?442Ljc6wGn(hKzzZYQVUG10)U@GCl^haZ)1`8Zl_daETDd!Gbk##PC><28<a$7vi9(vWAS23ZdxqNW-E>7)_Oilu@IgjT$Un=5$yU3fGYvXWqE6@ZwOAIZ&4LIuS-v8aYy~tpPM-M2aU1!oa~02F@H=EwZ$!H%AVJdU5ESVQ~gs#!zbbM5q@kj;J;$##rl<Bv~jkXxPXRm4@jVNpA>DSujRSpH^{<e!KJV!jV)LO3u+0YmA^!;_mKAgRfsG6G<lpoOU_Js1s*|?m6RRSA?#kN~XG2x(wJ*WSq2dyt>4-S7$~YDY@%aiJwt3wa9z4ZmLBc-hfOx#tfA->~~RXHaNCcMsn$u&<qeEciCBy?PWuQhV6wOLo{?n15n_Zw;xVFnHJGlbXnvUM<59VVGSao)Kd))9cPqd4c-u7TCD+9LsAYkl++9o#bl9qD2A8eW<4b|RzybGXpw0!G>F4tH$kD=W}i*S7i0%9^w~%SHdsS#4Z3!aOEzWp*+DYou$F8mefC=nWA=0ygL-X<6_a9Fm5_f{nHC^O;w99YY6E(unv<Zl31e%bk<?mBKw5;=bdeQjUvP%WWYu0GEp)?<5QSmtsi>x^>Z+`^>gubo#wzQqwAO0tt+?i@>#n>4"
)
"""1140 bytes packed by the library ncompress, whose codes grow from 9 to 10 bits."""
TEXT = "".join(f"P{i * i * 7919 % 100003:05d}\n" for i in range(120)).encode() + b"a" * 300

STARTS = {
    "CCSDS OEM": [
        OEM,
        "\n" + OEM,
        "\ufeff" + OEM,
        "COMMENT made up\n" + OEM,
        '<?xml version="1.0"?>\n<ndm><oem id="1">',
    ],
    "SP3": [sp3(), sp3(version="a"), "#cP1999  1  1\n"],
    "SPICE SPK": ["DAF/SPK \x02\x00"],
    "CCSDS AEM": [AEM, '<!-- made up --><ndm:aem xmlns:ndm="x">'],
}


@pytest.mark.parametrize("name", STARTS)
def test_first_lines_tell_the_format(tmp_path: Path, name: str) -> None:
    path = tmp_path / "file.csv"
    formats = ATTITUDES if name == "CCSDS AEM" else ORBITS
    for text in STARTS[name]:
        for data in (text.encode(), gzip.compress(text.encode())):
            path.write_bytes(data)
            found = recognised(path, formats)  # type: ignore[arg-type]
            assert found is not None
            assert found.name == name


@pytest.mark.parametrize(
    "text", ["time,x_m,y_m,z_m\n", "# a comment\n\n epoch, lat, lon, h\n", "#comment,1\nt,x,y,z\n", "PAR1"]
)
def test_a_table_is_known_by_its_row_of_names(tmp_path: Path, text: str) -> None:
    for name in ("orbit.oem", "orbit", "orbit.dat"):
        (tmp_path / name).write_text(text)
        assert recognised(tmp_path / name, ORBITS) is None


def test_campaigns_of_renamed_and_packed_files_are_the_same(tmp_path: Path) -> None:
    plain = load_campaign(write_good_campaign(tmp_path / "a")).campaign
    files = (
        (put("orbit.csv", OEM), put("att.txt", gzip.compress(AEM.encode())), "orbit.csv", "att.txt"),
        (put("o.oem.gz", gzip.compress(OEM.encode())), put("att", AEM), "o.oem.gz", "att"),
    )
    for n, (orbit, attitude, orbit_name, attitude_name) in enumerate(files):
        path = write_good_campaign(tmp_path / str(n))
        both(
            swap(TOML, "ephemeris.csv", orbit_name),
            swap(TOML, "attitude.csv", attitude_name),
            orbit,
            attitude,
        )(path.parent)
        loaded = load_campaign(path).campaign
        t_ns = plain.images.t_ns
        np.testing.assert_allclose(loaded.ephemeris.at(t_ns)[0], plain.ephemeris.at(t_ns)[0], atol=1e-6)
        np.testing.assert_allclose(loaded.attitude.at(t_ns)[0], plain.attitude.at(t_ns)[0], atol=1e-15)


def test_tables_may_be_packed_and_have_any_name(tmp_path: Path) -> None:
    path = write_good_campaign(tmp_path)
    plain = load_campaign(path).campaign
    for old, new in (("ephemeris.csv", "orbit.oem.gz"), ("attitude.csv", "attitude.dat")):
        data = (tmp_path / old).read_bytes()
        both(swap(TOML, old, new), put(new, gzip.compress(data)))(tmp_path)
        (tmp_path / old).unlink()
    again = load_campaign(path).campaign
    np.testing.assert_array_equal(again.ephemeris.r_J, plain.ephemeris.r_J)
    np.testing.assert_array_equal(again.attitude.q_EF, plain.attitude.q_EF)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (AEM, "orbit.x: found a file of the format CCSDS AEM, wanted a table or CCSDS OEM, SP3, SPICE SPK"),
        ("nothing", 'orbit.x: found a file that begins with "nothing", wanted a table or'),
        ("", "orbit.x: found a file that begins with"),
    ],
)
def test_what_is_none_of_them_is_refused(tmp_path: Path, data: str, says: str) -> None:
    (tmp_path / "orbit.x").write_text(data)
    with pytest.raises(InputError, match=says):
        recognised(tmp_path / "orbit.x", ORBITS)


@pytest.mark.parametrize(
    "key", ['columns = { x_m = "x" }', 'units = { position = "km" }', "keep = { mode = 1 }"]
)
def test_keys_of_a_table_beside_a_standard_file_are_refused(tmp_path: Path, key: str) -> None:
    path = write_good_campaign(tmp_path)
    both(
        swap(TOML, '"ephemeris.csv"', f'"orbit.txt"\n{key}'),
        put("orbit.txt", OEM),
    )(tmp_path)
    name = key.split()[0]
    with pytest.raises(
        InputError, match=rf"orbit\.txt: found .*CCSDS OEM.*wanted ephemeris\.{name} left out"
    ):
        load_campaign(path)


def test_compress_and_gzip_are_unpacked() -> None:
    assert unpacked("x", COMPRESSED, 10**6) == TEXT
    assert unpacked("x", gzip.compress(TEXT[:500]) + gzip.compress(TEXT[500:]), 10**6) == TEXT
    assert unpacked("x", TEXT, 10**6) == TEXT


@pytest.mark.parametrize("packed", [COMPRESSED, gzip.compress(TEXT)], ids=["Z", "gz"])
def test_packed_files_are_bounded_and_whole(packed: bytes) -> None:
    with pytest.raises(InputError, match="x: found a packed file of more than 1,139 bytes"):
        unpacked("x", packed, most=1139)
    assert unpacked("x", packed, most=1140) == TEXT


@pytest.mark.parametrize(
    "packed",
    [
        gzip.compress(TEXT)[:-12],
        gzip.compress(TEXT)[:-4] + b"none",
        b"\x1f\x8bnothing",
        b"\x1f\x9d",
        b"\x1f\x9d\x83abc",
        b"\x1f\x9d\x90\xff\xff\xff\xff",
    ],
    # gzip writes the time, and workers must name tests alike
    ids=["cut", "wrong length", "no block", "no bits", "too few bits", "no codes"],
)
def test_damaged_packed_files_are_refused(packed: bytes) -> None:
    with pytest.raises(InputError, match=r"x: found a damaged packed file .*wanted a whole one"):
        unpacked("x", packed, 10**6)
