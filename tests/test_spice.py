"""SPICE kernels against spiceypy itself."""

from __future__ import annotations

import builtins
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import starplumb as sp
from helpers import CAMPAIGN, write_good_campaign
from starplumb.io.formats.spice import (
    FrameIds,
    frame_kernel_text,
    frame_name,
    read_spk,
    tdb_seconds,
)
from starplumb.io.formats.spice import loaded as kernel_loaded
from starplumb.io.formats.spice_names import frame_name_fault
from starplumb.physics import timescales
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCSEC

spice = pytest.importorskip("spiceypy")

S = 1_000_000_000
BODY = -999
GM = 398600.4418
RADIUS = 7000.0
RATE = np.sqrt(GM / RADIUS**3)
NODE = 600_000_000 * S  # January 2019

LEAP_KERNEL = """KPL/LSK
\\begindata
DELTET/DELTA_T_A = 32.184
DELTET/K = 1.657D-3
DELTET/EB = 1.671D-2
DELTET/M = ( 6.239996D0 1.99096871D-7 )
DELTET/DELTA_AT = ( 32, @1999-JAN-1, 33, @2006-JAN-1, 34, @2009-JAN-1, 35, @2012-JUL-1, 36, @2015-JUL-1,
                    37, @2017-JAN-1 )
\\begintext
"""


pytestmark = pytest.mark.usefixtures("clean_pool")


@pytest.fixture
def leap_kernel(tmp_path: Path):
    path = tmp_path / "leap.tls"
    path.write_text(LEAP_KERNEL)
    spice.furnsh(str(path))
    yield
    spice.unload(str(path))


def states(et):
    """Circular orbit, tilted: km and km/s."""
    angle = RATE * (np.asarray(et) - 6e8)
    tilt = Rotation.from_euler("x", 97.8, degrees=True)
    zero = np.zeros_like(angle)
    r = RADIUS * np.stack([np.cos(angle), np.sin(angle), zero], axis=-1)
    v = RADIUS * RATE * np.stack([-np.sin(angle), np.cos(angle), zero], axis=-1)
    return np.hstack([tilt.apply(r), tilt.apply(v)])


@pytest.fixture
def spk(tmp_path: Path):
    """Writes a type 13 kernel; every arc is (body, first epoch, number of 10 s nodes)."""

    def write(*arcs: tuple[int, int, int], center: int = 399) -> Path:
        path = tmp_path / "orbit.bsp"
        handle = spice.spkopn(str(path), "ORBIT", 0)
        for body, first_ns, count in arcs:
            et = tdb_seconds(first_ns + 10 * S * np.arange(count))
            spice.spkw13(
                handle,
                body,
                center,
                "J2000",
                et[0],
                et[-1],
                "ARC",
                7,
                count,
                np.ascontiguousarray(states(et)),
                et,
            )
        spice.spkcls(handle)
        return path

    return write


@pytest.mark.parametrize("year", [2000, 2018, 2026])
def test_tdb_is_that_of_spice(leap_kernel, year):
    texts = [f"{year}-{month:02d}-05T06:07:08.25" for month in range(1, 13)]
    expected = [spice.str2et(text) for text in texts]
    np.testing.assert_allclose(tdb_seconds(timescales.parse(texts, "UTC")), expected, rtol=0, atol=3e-7)


def test_spk_states_at_the_epochs_asked_for(spk):
    table = read_spk(spk((BODY, NODE, 100)), step_s=7.0, start_ns=NODE + 95 * S, stop_ns=NODE + 200 * S)
    assert table.t_ns.tolist() == [NODE + s * S for s in [*range(95, 200, 7), 200]]
    expected = states(tdb_seconds(table.t_ns)) * 1e3
    np.testing.assert_allclose(table.r, expected[:, :3], atol=1e-3)
    np.testing.assert_allclose(table.v, expected[:, 3:], atol=1e-5)
    assert (table.frame, table.object_name, table.segments) == ("GCRF", "-999", ((0, 16),))


def test_spk_without_span_is_sampled_from_end_to_end(spk):
    table = read_spk(spk((BODY, NODE, 20)))
    np.testing.assert_array_equal(table.t_ns, NODE + 10 * S * np.arange(20))


def test_spk_whose_ends_are_a_rounding_off(spk):
    table = read_spk(spk((BODY, NODE + 120, 20)))
    assert table.t_ns[[0, 1, -1]].tolist() == [NODE, NODE + 10 * S, NODE + 190 * S]


def test_spk_coverage_with_a_gap_gives_segments(spk):
    table = read_spk(spk((BODY, NODE, 20), (BODY, NODE + 1000 * S, 20)), stop_ns=NODE + 1100 * S)
    assert table.segments == ((0, 20), (20, 31))
    assert table.t_ns[20] == NODE + 1000 * S


def test_spk_with_several_bodies_needs_a_name(spk):
    path = spk((BODY, NODE, 20), (-998, NODE, 20))
    with pytest.raises(InputError, match=r"orbit.bsp: holds 2 bodies, name one of -999, -998"):
        read_spk(path)
    assert read_spk(path, target=-998).object_name == "-998"
    with pytest.raises(InputError, match=r"holds no body 5, name one of -999, -998"):
        read_spk(path, target=5)


def test_spk_span_outside(spk):
    with pytest.raises(
        InputError, match=r"nothing lies in 2000-01-01T12:00:00.000 .*covers 2019-01-05T22:40:00.000"
    ):
        read_spk(spk((BODY, NODE, 20)), start_ns=0, stop_ns=S)


def test_spk_not_about_the_earth_names_spices_reason(spk):
    with pytest.raises(InputError, match=r"SPICE cannot use this kernel: SPICE.SPKINSUFFDATA"):
        read_spk(spk((BODY, NODE, 20), center=499))


def test_spk_wrong_files(tmp_path):
    path = tmp_path / "x.bsp"
    path.write_text("KPL/MK\n\\begindata\nKERNELS_TO_LOAD = ('/etc/passwd')\n")
    with pytest.raises(InputError, match=r"x.bsp: is not a SPICE SPK"):
        read_spk(path)
    path.write_bytes(b"DAF/SPK " + bytes(2000))
    with pytest.raises(InputError, match=r"found the format .* of numbers, wanted LTL-IEEE or BIG-IEEE"):
        read_spk(path)
    with pytest.raises(InputError, match="no such file"):
        read_spk(tmp_path / "none.bsp")
    with pytest.raises(InputError, match="step is 0"):
        read_spk(path, step_s=0.0)


def test_spiceypy_missing_names_the_remedy(tmp_path, monkeypatch):
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name == "spiceypy":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r'pip install "starplumb\[spice\]"'):
        read_spk(tmp_path / "x.bsp")


# Frame kernel

ROUNDING = 4.5e-16
"""Two units in the last place: SPICE makes the matrix orthonormal anew as it reads it."""

C_EK = Rotation.from_rotvec([0.3, -1.2, 2.0]).as_matrix()


def loaded(path: Path, call):
    spice.furnsh(str(path))
    try:
        return call()
    finally:
        spice.unload(str(path))


def write_frame_kernel(path, *arguments, **options):
    path.write_text(frame_kernel_text(*arguments, **options), encoding="ascii", newline="\n")


def test_frame_kernel_gives_back_the_mounting(tmp_path, rng):
    for C in [C_EK, *Rotation.random(20, random_state=rng).as_matrix()]:
        write_frame_kernel(tmp_path / "m.tf", C, "camera", "star_tracker")
        found = loaded(tmp_path / "m.tf", lambda: spice.pxform("camera", "star_tracker", 0.0))
        assert np.abs(found - C).max() <= ROUNDING
        back = loaded(tmp_path / "m.tf", lambda: spice.pxform("STAR_TRACKER", "CAMERA", 1e9))
        assert np.abs(back - C.mT).max() <= ROUNDING


def test_frame_kernel_ids_and_a_tracker_defined_elsewhere(tmp_path):
    ids = FrameIds(camera=1_500_000, tracker=None, spacecraft=-12)
    write_frame_kernel(tmp_path / "m.tf", C_EK, "PAN", "J2000", ids=ids)
    found = loaded(tmp_path / "m.tf", lambda: (spice.pxform("PAN", "J2000", 0.0), spice.namfrm("PAN")))
    assert np.abs(found[0] - C_EK).max() <= ROUNDING
    assert found[1] == 1_500_000


def test_frame_kernel_says_covariance_and_comments(tmp_path):
    covariance = np.diag([1.0, 4.0, 9.0]) * ARCSEC**2
    comments = ["A long line " * 20, "\\begindata", "Pléiades 1B\tline one\nline two", ""]
    write_frame_kernel(tmp_path / "m.tf", C_EK, covariance_E=covariance, comments=comments)
    text = (tmp_path / "m.tf").read_bytes().decode("ascii")
    assert text.startswith("KPL/FK\n")
    assert "arcsec^2" in text
    assert "4.000000000e+00" in text
    assert max(map(len, text.split("\n"))) <= 80
    assert text.count("\\begindata") == 1
    assert loaded(tmp_path / "m.tf", lambda: spice.namfrm("CAMERA")) == 1_400_001


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("camera", "CAMERA"),
        ("star tracker 1", "STAR_TRACKER_1"),
        ("1st", "F_1ST"),
        ("é", "_"),
        ("x" * 40, "X" * 26),
    ],
)
def test_frame_names_are_made_fit_for_spice(tmp_path, given, name):
    assert frame_name(given) == ("F__" if name == "_" else name)
    write_frame_kernel(tmp_path / "m.tf", C_EK, given, "body")
    found = loaded(tmp_path / "m.tf", lambda: spice.pxform(frame_name(given), "BODY", 0.0))
    assert np.abs(found - C_EK).max() <= ROUNDING


def test_the_names_of_spices_own_frames_are_refused():
    own = {spice.frmnam(number) for number in range(1, 20_000)} - {""}
    assert {"J2000", "IAU_EARTH", "ITRF93"} < own
    assert [name for name in own if frame_name_fault(name) is None] == []


SPICE = """
[spice]
camera = { name = "SAT1_CAM", id = -999101 }
tracker = { name = "sat1_str", id = -999001 }
spacecraft_id = -999
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stated", "names", "ids", "craft"),
    [
        ("", ("CAMERA", "ADCS_HEAD_1"), (1_400_001, 1_400_002), -999),
        (SPICE, ("SAT1_CAM", "SAT1_STR"), (-999_101, -999_001), -999),
        ("[spice]\ncamera = { id = -143_101 }\n", ("CAMERA", "ADCS_HEAD_1"), (-143_101, 1_400_002), -143),
    ],
    ids=["by the mounting", "stated", "satellite by the id"],
)
def test_the_kernel_of_a_campaign_has_the_names_it_states(tmp_path, stated, names, ids, craft):
    """The answer is the identity: the kernel of the campaign gives C_EK of its result."""
    toml = CAMPAIGN.replace("star_tracker", "adcs head 1") + stated
    result = sp.calibrate(sp.read_campaign(write_good_campaign(tmp_path, campaign=toml)), method="gls")
    assert result.usable
    result.save(tmp_path / "result", report=False)

    def found():
        frames = tuple(spice.namfrm(name) for name in names)
        return spice.pxform(*names, 0.0), frames, [spice.frinfo(frame) for frame in frames]

    C, numbers, info = loaded(tmp_path / "result" / "mounting.tf", found)
    assert np.abs(C - result.C_EK).max() <= 1e-15  # the answer itself is a rotation to a rounding
    assert numbers == ids
    assert [each[0] for each in info] == [craft, craft]
    assert [each[1] for each in info] == [4, 3]
    assert [each[2] for each in info] == list(ids)


def test_frame_kernel_refuses_one_name_or_one_id_for_both():
    with pytest.raises(InputError, match="names of both frames are A_B"):
        frame_kernel_text(C_EK, "a b", "A_B")
    with pytest.raises(InputError, match="both SPICE frames have the ID 1400005"):
        FrameIds(1_400_005, 1_400_005)
    with pytest.raises(InputError, match="ID is 17, wanted 1400000"):
        FrameIds(17)


def test_what_spice_says_is_cut_to_a_sentence(spk):
    path = spk((-999, 0, 60))
    with pytest.raises(InputError, match=r"long +\.\.\.$") as error, kernel_loaded(spice, "o.bsp", path):
        raise spice.utils.exceptions.SpiceyError(long="long " * 300)
    assert len(str(error.value)) < 400
