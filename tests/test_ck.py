"""Attitude from SPICE C-kernels, against SPICE itself: written and turned by spiceypy."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bad_cases import both, put, swap
from helpers import write_good_campaign
from starplumb.io.campaign.read import load_campaign
from starplumb.io.formats.attitudes.ck import read_ck
from starplumb.io.formats.registry import ATTITUDES, recognised
from starplumb.io.formats.spice import tdb_seconds
from starplumb.physics.errors import InputError

spice = pytest.importorskip("spiceypy")

BUS, CLOCK = -999000, -999
SCLK = """KPL/SCLK
\\begindata
SCLK_KERNEL_ID             = ( @2020-01-01/00:00:00 )
SCLK_DATA_TYPE_999         = ( 1 )
SCLK01_TIME_SYSTEM_999     = ( 1 )
SCLK01_N_FIELDS_999        = ( 2 )
SCLK01_MODULI_999          = ( 4294967296 65536 )
SCLK01_OFFSETS_999         = ( 0 0 )
SCLK01_OUTPUT_DELIM_999    = ( 1 )
SCLK_PARTITION_START_999   = ( 0.0000000000000E+00 )
SCLK_PARTITION_END_999     = ( 2.8147497671065E+14 )
SCLK01_COEFFICIENTS_999    = ( 0.0000000000000E+00  6.3000000000000E+08  1.0000010000000E+00 )
\\begintext
"""
FRAMES = """KPL/FK
\\begindata
FRAME_SAT1_BUS          = -999000
FRAME_-999000_NAME      = 'SAT1_BUS'
FRAME_-999000_CLASS     = 3
FRAME_-999000_CLASS_ID  = -999000
FRAME_-999000_CENTER    = -999
CK_-999000_SCLK         = -999
CK_-999000_SPK          = -999
FRAME_SAT1_PLATE         = -999010
FRAME_-999010_NAME      = 'SAT1_PLATE'
FRAME_-999010_CLASS     = 4
FRAME_-999010_CLASS_ID  = -999010
FRAME_-999010_CENTER    = -999
TKFRAME_-999010_RELATIVE = 'SAT1_BUS'
TKFRAME_-999010_SPEC    = 'ANGLES'
TKFRAME_-999010_UNITS   = 'DEGREES'
TKFRAME_-999010_AXES    = ( 1, 3, 2 )
TKFRAME_-999010_ANGLES  = ( 30.0, -10.0, 77.0 )
FRAME_SAT1_STR          = -999001
FRAME_-999001_NAME      = 'SAT1_STR'
FRAME_-999001_CLASS     = 4
FRAME_-999001_CLASS_ID  = -999001
FRAME_-999001_CENTER    = -999
TKFRAME_-999001_RELATIVE = 'SAT1_PLATE'
TKFRAME_-999001_SPEC    = 'ANGLES'
TKFRAME_-999001_UNITS   = 'DEGREES'
TKFRAME_-999001_AXES    = ( 3, 1, 3 )
TKFRAME_-999001_ANGLES  = ( 5.0, 60.0, -20.0 )
\\begintext
"""
T0 = 631_000_000.0
"""TDB of the first sample, in December 2019."""


pytestmark = pytest.mark.usefixtures("clean_pool")


@pytest.fixture
def kernels(tmp_path):
    """Clock and frames."""
    (tmp_path / "sat.tsc").write_text(SCLK)
    (tmp_path / "sat.tf").write_text(FRAMES)
    return tmp_path / "sat.tsc", tmp_path / "sat.tf"


@pytest.fixture
def write(tmp_path, kernels):
    """Writes a C-kernel of segments (kind, reference, structure, times after T0, starts, attitude C_BA)."""

    def of(*segments, name="att.bc"):
        path = tmp_path / name
        path.unlink(missing_ok=True)
        spice.furnsh(str(kernels[0]))
        handle = spice.ckopn(str(path), "made up", 0)
        for kind, reference, structure, times, starts, C in segments:
            ticks = np.array([spice.sce2c(CLOCK, T0 + t) for t in times])
            quaternions = np.roll(C.as_quat(), 1, axis=-1)
            rates = np.zeros((len(ticks), 3))
            first, last = ticks[0], ticks[-1]
            if kind == 3:
                begins = ticks[list(starts)]
                rest = (len(ticks), ticks, quaternions, rates, len(starts), begins)
                spice.ckw03(handle, first, last, structure, reference, bool(structure % 2), "s", *rest)
            elif kind == 1:
                rest = (len(ticks), ticks, quaternions, rates)
                spice.ckw01(handle, first, last, structure, reference, False, "s", *rest)
            else:
                rest = (
                    len(ticks) - 1,
                    ticks[:-1],
                    (ticks[:-1] + ticks[1:]) / 2 if starts else ticks[1:],
                    quaternions[:-1],
                    rates[:-1],
                    np.full(len(ticks) - 1, 1e-5),
                )
                spice.ckw02(handle, first, last, structure, reference, "s", *rest)
        spice.ckcls(handle)
        spice.kclear()
        return path

    return of


def attitude(rng, n, rate=1e-3):
    return Rotation.from_rotvec(rate * np.arange(n)[:, None] * [0.3, -0.5, 0.8]) * Rotation.from_quat(
        rng.standard_normal(4)
    )


def by_spice(path, kernels, frame, t_ns):
    """C_BA of SPICE at epochs (n,)."""
    for kernel in (*kernels, path):
        spice.furnsh(str(kernel))
    found = np.array([spice.pxform("J2000", frame, float(et)) for et in tdb_seconds(t_ns)])
    spice.kclear()
    return found


@pytest.mark.parametrize("frame", ["SAT1_BUS", "SAT1_PLATE", "SAT1_STR"])
def test_every_sample_is_what_spice_says_of_the_frame(write, kernels, rng, frame):
    """The last two frames are fixed to the first, one and two steps down."""
    times = 0.5 * np.arange(230.0)
    path = write((3, "J2000", BUS, times, (0, 120), attitude(rng, 230)))
    table = read_ck(path, kernels, frame)
    np.testing.assert_allclose(tdb_seconds(table.t_ns), T0 + times, atol=2e-5)
    found = Rotation.from_quat(table.q_BA_xyzw).as_matrix()
    np.testing.assert_allclose(found, by_spice(path, kernels, frame, table.t_ns), atol=2e-8)
    assert table.segments == ((0, 120), (120, 230))
    assert (table.frame_a, table.frame_b, table.notices) == ("GCRF", frame, ())


def test_samples_come_as_they_were_written(write, kernels, rng):
    C = attitude(rng, 7, 0.4)
    for kind in (1, 3):
        table = read_ck(write((kind, "J2000", BUS, np.arange(7.0), (0,), C)), kernels, "SAT1_BUS")
        np.testing.assert_allclose(Rotation.from_quat(table.q_BA_xyzw).as_matrix(), C.as_matrix(), atol=1e-15)
    rates = read_ck(write((3, "J2000", BUS - 1, np.arange(7.0), (0,), C)), kernels, "somebody")
    np.testing.assert_allclose(Rotation.from_quat(rates.q_BA_xyzw).as_matrix(), C.as_matrix(), atol=1e-15)
    assert "took its structure -999001 for somebody" in rates.notices[0]


def test_other_types_are_sampled(write, kernels, rng):
    path = write((2, "J2000", BUS, np.arange(4.0), (), attitude(rng, 4)))
    table = read_ck(path, kernels, "SAT1_STR")
    assert 30 <= len(table.t_ns) <= 32
    inner = slice(1, -1)
    found = Rotation.from_quat(table.q_BA_xyzw).as_matrix()[inner]
    np.testing.assert_allclose(found, by_spice(path, kernels, "SAT1_STR", table.t_ns[inner]), atol=1e-7)


def test_a_segment_without_attitude_in_between_is_parted_there(write, kernels, rng):
    """Intervals of half a second, half a second apart: a tenth of a second is looked at."""
    table = read_ck(write((2, "J2000", BUS, np.arange(4.0), (0,), attitude(rng, 4))), kernels, "SAT1_STR")
    assert len(table.segments) == 3
    assert all(5 <= end - start <= 7 for start, end in table.segments)
    gaps = [
        table.t_ns[after] - table.t_ns[before - 1] for (_, before), (after, _) in pairwise(table.segments)
    ]
    np.testing.assert_allclose(gaps, 5e8, atol=1.1e8)


def test_another_inertial_frame_and_an_earth_fixed_one(write, kernels, rng):
    C = attitude(rng, 3)
    path = write((3, "ECLIPJ2000", BUS, np.arange(3.0), (0,), C))
    table = read_ck(path, kernels, "SAT1_BUS")
    found = Rotation.from_quat(table.q_BA_xyzw).as_matrix()
    np.testing.assert_allclose(found, by_spice(path, kernels, "SAT1_BUS", table.t_ns), atol=1e-12)
    assert table.frame_a == "GCRF"
    table = read_ck(write((3, "ITRF93", BUS, np.arange(3.0), (0,), C)), kernels, "SAT1_BUS")
    assert table.frame_a == "ITRF"
    np.testing.assert_allclose(Rotation.from_quat(table.q_BA_xyzw).as_matrix(), C.as_matrix(), atol=1e-15)


def test_segments_are_arcs_and_must_not_overlap(write, kernels, rng):
    one, two = attitude(rng, 3), attitude(rng, 2)
    later = (3, "J2000", BUS, np.arange(10.0, 12.0), (0,), two)
    table = read_ck(write(later, (3, "J2000", BUS, np.arange(3.0), (0,), one)), kernels, "SAT1_BUS")
    assert table.segments == ((0, 3), (3, 5))
    np.testing.assert_allclose(
        Rotation.from_quat(table.q_BA_xyzw[3:]).as_matrix(), two.as_matrix(), atol=1e-15
    )
    overlapping = write(later, (3, "J2000", BUS, np.arange(9.0, 12.0), (0,), one))
    with pytest.raises(InputError, match="found segments that overlap in time"):
        read_ck(overlapping, kernels, "SAT1_BUS")


def test_what_is_missing_is_said(write, kernels, tmp_path, rng):
    C = attitude(rng, 3)
    path = write((3, "J2000", BUS, np.arange(3.0), (0,), C))
    with pytest.raises(InputError, match=r"att\.bc: found no kernel of the clock -999, wanted it \(SCLK"):
        read_ck(path, (), "anything")
    with pytest.raises(InputError, match="wanted -999000, on which"):
        read_ck(write((3, "J2000", -998000, np.arange(3.0), (0,), C)), (*kernels,), "SAT1_STR")
    two = write((3, "J2000", BUS, np.arange(3.0), (0,), C), (3, "J2000", -999777, np.arange(3.0), (0,), C))
    with pytest.raises(InputError, match=r'found 2 structures .* and no kernel that knows "STR"'):
        read_ck(two, kernels[:1], "STR")
    with pytest.raises(InputError, match='found "IAU_EARTH" to be no frame of a C-kernel'):
        read_ck(path, kernels, "IAU_EARTH")
    with pytest.raises(InputError, match='found the reference frame "IAU_EARTH"'):
        read_ck(write((3, "IAU_EARTH", BUS, np.arange(3.0), (0,), C)), kernels, "SAT1_BUS")
    (tmp_path / "all.tm").write_text("KPL/MK\n\\begindata\nKERNELS_TO_LOAD = ( 'sat.tsc' )\n\\begintext\n")
    with pytest.raises(InputError, match=r"all\.tm: found a meta-kernel, which names other kernels"):
        read_ck(path, (tmp_path / "all.tm",), "SAT1_BUS")


def test_a_campaign_names_the_kernels(write, kernels, rng, tmp_path):
    """Its images are at 2020-01-01, its attitude constant; the digests of the kernels stand among the inputs."""
    toml = write_good_campaign(tmp_path / "campaign")
    plain = load_campaign(toml).campaign
    q = plain.attitude.q_EF[0]
    C = Rotation.from_quat(np.tile(q, (3, 1)))
    et = tdb_seconds(plain.attitude.t_ns[[0, -1]]) - T0
    path = write((3, "ITRF93", BUS, np.array([et[0] - 1.0, et[0] + 1.0, et[1] + 1.0]), (0,), C))
    both(
        swap("campaign.toml", '"attitude.csv"', '"att.bc"\nkernels = ["sat.tsc"]'),
        put("att.bc", path.read_bytes()),
        put("sat.tsc", kernels[0].read_bytes()),
    )(toml.parent)
    loaded = load_campaign(toml)
    t_ns = plain.images.t_ns
    np.testing.assert_allclose(loaded.campaign.attitude.at(t_ns)[0], plain.attitude.at(t_ns)[0], atol=1e-14)
    assert {"att.bc", "sat.tsc"} <= set(loaded.inputs)
    swap("campaign.toml", '"att.bc"', '"attitude.csv"')(toml.parent)
    with pytest.raises(InputError, match=r"attitude\.csv: found a table beside attitude\.kernels"):
        load_campaign(toml)


def test_a_kernel_is_known_by_its_first_bytes(write, rng):
    path = write((3, "J2000", BUS, np.arange(3.0), (0,), attitude(rng, 3)), name="att.x")
    assert recognised(path, ATTITUDES).name == "SPICE CK"
