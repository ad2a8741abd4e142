"""Attitude from ORBEX files."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bad_cases import AEM, both, put, swap
from helpers import write_good_campaign
from starplumb.io.campaign.read import load_campaign
from starplumb.io.formats.attitudes.orbex import read_orbex
from starplumb.io.formats.registry import ATTITUDES, recognised
from starplumb.physics.errors import InputError
from starplumb.physics.timescales import parse

ORBEX = """%=ORBEX  0.09
%%
*------------------------------------------------------------------------------------------------------
+FILE/DESCRIPTION
 DESCRIPTION         made up
 CREATED_BY          nobody
 TIME_SYSTEM         GPS
 START_TIME          2020 01 01 00 00  0.000000000000
 COORD_SYSTEM        IGS14
 FRAME_TYPE          ECEF
 LIST_OF_REC_TYPES   ATT
-FILE/DESCRIPTION
+SATELLITE/ID_AND_DESCRIPTION
 L47
 G05
-SATELLITE/ID_AND_DESCRIPTION
+EPHEMERIS/DATA
*ATT RECORDS: TRANSFORMATION FROM TERRESTRIAL FRAME COORDINATES (T) TO SAT. BODY FRAME ONES (B) SUCH AS
*                                 (0,B) = q.(0,T).trans(q)
*REC ID_              N ___q0_(scalar)_____ ____q1__x__________ ____q2__y__________ ____q3__z__________
## 2020 01 01 00 00 18.000000000000   2
 ATT L47              4  0.7071067811865476  0.7071067811865476  0.0000000000000000  0.0000000000000000
 ATT G05              4  0.1000000000000000  0.7000000000000000  0.5000000000000000  0.5000000000000000
## 2020 01 01 00 00 28.500000000000   2
 ATT L47    FLAGS     4  0.6                -0.8                 0.0                 0.0
 ATT G05              4  0.1                 0.7                 0.5                 0.5
-EPHEMERIS/DATA
%END_ORBEX
"""


@pytest.fixture
def write(tmp_path):
    def of(text):
        (tmp_path / "a.obx").write_text(text)
        return tmp_path / "a.obx"

    return of


def test_the_quaternion_is_that_of_its_own_comment(write):
    """(0, v_B) = q (0, v_T) q*, multiplied out by hand for v_T = y: q = (1 + i) / sqrt 2 gives z; q = 0.6 - 0.8 i
    gives (0.36 - 0.64) y - 0.96 z."""
    table = read_orbex(write(ORBEX), "L47")
    C_BT = Rotation.from_quat(table.q_BA_xyzw)
    np.testing.assert_allclose(
        C_BT.apply([0.0, 1.0, 0.0]), [[0.0, 0.0, 1.0], [0.0, -0.28, -0.96]], atol=1e-15
    )
    assert table.t_ns.tolist() == parse(["2020-01-01T00:00:00", "2020-01-01T00:00:10.5"], "UTC").tolist()
    assert (table.frame_a, table.object_name) == ("ITRF", "L47")
    inertial = read_orbex(write(ORBEX.replace("ECEF", "ECI").replace(" GPS", " TAI")), "G05")
    assert inertial.frame_a == "GCRF"
    np.testing.assert_array_equal(inertial.q_BA_xyzw, [[0.7, 0.5, 0.5, 0.1]] * 2)


def test_a_campaign_of_orbex_is_that_of_a_ccsds_message(tmp_path, write):
    """CCSDS's Q is the conjugate of q, scalar last."""
    records = "".join(
        f"## 2020 01 01 00 00 {second}.0 1\n ATT BIRD 4 0.5 0.5 0.5 -0.5\n" for second in (18, 22)
    )
    text = ORBEX[: ORBEX.index("## ")] + records + "-EPHEMERIS/DATA\n%END_ORBEX\n"
    one = write_good_campaign(tmp_path / "one")
    both(swap("campaign.toml", "attitude.csv", "a.aem"), put("a.aem", AEM))(one.parent)
    two = write_good_campaign(tmp_path / "two")
    both(swap("campaign.toml", "attitude.csv", "sat.obx"), put("sat.obx", text))(two.parent)
    one, two = load_campaign(one).campaign, load_campaign(two).campaign
    t_ns = one.images.t_ns
    np.testing.assert_allclose(two.attitude.at(t_ns)[0], one.attitude.at(t_ns)[0], atol=1e-15)


def test_the_satellite_is_named_in_the_campaign(tmp_path):
    path = write_good_campaign(tmp_path)
    both(swap("campaign.toml", '"attitude.csv"', '"sat.obx"\nobject = "L48"'), put("sat.obx", ORBEX))(
        tmp_path
    )
    with pytest.raises(
        InputError, match=r'found no satellite "L48", wanted one of G05, L47 as attitude\.object says'
    ):
        load_campaign(path)
    put("sat.obx", AEM)(tmp_path)
    with pytest.raises(InputError, match=r'found the object "BIRD" .* wanted "L48" as attitude\.object says'):
        load_campaign(path)
    swap("campaign.toml", '"sat.obx"', '"attitude.csv"')(tmp_path)
    with pytest.raises(InputError, match=r"found a table beside attitude\.object"):
        load_campaign(path)


def test_the_file_is_known_by_its_first_line(write):
    assert recognised(write(ORBEX), ATTITUDES).name == "ORBEX"


FAULTS = {
    "several": ("x", "x", "found 2 satellites (G05, L47), wanted one named by attitude.object"),
    "no frame": (" FRAME_TYPE          ECEF\n", "", 'found the FRAME_TYPE "", wanted ECEF or ECI'),
    "another frame": ("ECEF", "LVLH", 'line 10: found the FRAME_TYPE "LVLH"'),
    "another clock": ("         GPS", "         BDT", 'line 7: found the TIME_SYSTEM "BDT"'),
    "no epoch": ("## 2020 01 01 00 00 18.000000000000   2\n", "", "line 21: found a record before any epoch"),
    "no date": ("## 2020 01 01 00 00 18.0", "## 2020 13 01 00 00 18.0", "line 22: "),
    "no numbers": ("## 2020 01 01 00 00 18.0", "## 2020 01 01 00 00 x", "line 21: found"),
    "three numbers": (
        "  0.7071067811865476  0.0000000000000000  0",
        "  0.7071067811865476  0",
        "line 22: found",
    ),
    "not a number": ("4  0.6 ", "4  nan ", "line 25: found"),
    "norm": ("4  0.6 ", "4  0.7 ", "line 25: the quaternion has norm 1.06301"),
    "back": ("## 2020 01 01 00 00 28.5", "## 2020 01 01 00 00 08.5", "not later than before"),
    "broken off": ("-EPHEMERIS/DATA\n%END_ORBEX\n", "", 'line 26: found the end within "EPHEMERIS/DATA"'),
    "nothing": (" ATT", " POS", "found no record ATT"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_what_cannot_be_used_is_said(write, case):
    old, new, message = FAULTS[case]
    text = ORBEX.replace(old, new)
    with pytest.raises(InputError) as error:
        read_orbex(write(text), None if case == "several" else "L47")
    assert message in str(error.value)
    assert "\n" not in str(error.value)
