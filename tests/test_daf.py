"""SPICE kernels whose structure is damaged: refused before SPICE, which would die of them, opens them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from starplumb.io.formats.kernels.daf import require_whole
from starplumb.io.formats.spice import read_spk
from starplumb.physics.errors import InputError

spice = pytest.importorskip("spiceypy")

CASES = Path(__file__).resolve().parents[2] / "shared" / "cases"
FREE = 84
"""Byte of the first free address."""


def orbit(path, kind, n):
    """A kernel as SPICE itself writes it."""
    angle = np.linspace(0.0, 1.0, n)
    zero = 0.0 * angle
    states = np.stack(
        [7e3 * np.cos(angle), 7e3 * np.sin(angle), zero, -7 * np.sin(angle), 7 * np.cos(angle), zero], -1
    )
    states, times = np.ascontiguousarray(states), 6e8 + 10.0 * np.arange(n)
    handle = spice.spkopn(str(path), "made up", 0)
    head = (handle, -999, 399, "J2000", times[0], times[-1], "arc")
    match kind:
        case 2:
            spice.spkw02(*head, 10.0, n - 1, 6, np.ones((n - 1) * 21), times[0])
        case 3:
            spice.spkw03(*head, 10.0, n - 1, 6, np.ones((n - 1) * 42), times[0])
        case 5:
            spice.spkw05(*head, 398600.4, n, states, times)
        case 8:
            spice.spkw08(*head, 7, n, states, times[0], 10.0)
        case 9:
            spice.spkw09(*head, 7, n, states, times)
        case 12:
            spice.spkw12(*head, 7, n, states, times[0], 10.0)
        case 13:
            spice.spkw13(*head, 7, n, states, times)
    spice.spkcls(handle)
    return path


def last_word(path):
    """Byte at which the last word of the first segment begins."""
    data = path.read_bytes()
    record = struct.unpack("<i", data[76:80])[0]
    at = (record - 1) * 1024 + 24 + 16 + 20
    return 8 * (struct.unpack("<i", data[at : at + 4])[0] - 1)


@pytest.mark.parametrize("n", [12, 101, 250])
@pytest.mark.parametrize("kind", [2, 3, 5, 8, 9, 12, 13])
def test_what_spice_writes_is_whole_and_a_count_that_is_off_is_not(tmp_path, kind, n):
    path = orbit(tmp_path / "orbit.bsp", kind, n)
    require_whole(path, path)
    at = last_word(path)
    data = bytearray(path.read_bytes())
    (count,) = struct.unpack("<d", data[at : at + 8])
    for wrong in (count + 1, count - 1, 0.0, -3.0, 0.5, 1e300, np.nan):
        data[at : at + 8] = struct.pack("<d", wrong)
        path.write_bytes(data)
        with pytest.raises(InputError, match=r"orbit\.bsp: found a damaged kernel, ") as error:
            require_whole(path, path)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", [2, 3, 5, 8, 9, 12, 13])
def test_a_segment_for_times_beyond_what_it_holds_is_refused(tmp_path, kind):
    """SPICE itself writes none, and would go on from the last states by a polynomial."""
    path = orbit(tmp_path / "orbit.bsp", kind, 101)
    data = path.read_bytes()
    record = struct.unpack("<i", data[76:80])[0]
    at = (record - 1) * 1024 + 24
    opens, closes = struct.unpack("<2d", data[at : at + 16])
    far = 2e6 if kind == 5 else 1.0
    for span in ((opens - far, closes), (opens, closes + far)):
        changed(path, at, struct.pack("<2d", *span))
        with pytest.raises(InputError, match=r"a segment for .*, wanted times within [56]"):
            require_whole(path, path)
    changed(path, at, struct.pack("<2d", opens + 20.0, closes - 20.0))  # a part of it may be named
    require_whole(path, path)


def changed(path, at, value):
    data = bytearray(path.read_bytes())
    data[at : at + len(value)] = value
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (
            lambda path, end: changed(path, end - 8, struct.pack("<d", 40.0)),
            "40 as the degree, wanted a whole number",
        ),
        (lambda path, end: changed(path, end - 16, struct.pack("<d", 6e8)), "a directory of other times"),
        (lambda path, end: changed(path, end - 40, struct.pack("<d", 6e8)), "times that do not increase"),
        (
            lambda path, end: changed(path, 12, struct.pack("<i", 169)),
            "summaries of 2 and 169 numbers, wanted 2 and 6",
        ),
        (lambda path, end: changed(path, 76, struct.pack("<i", 99)), "record 99 as one of summaries"),
        (
            lambda path, end: changed(path, FREE, struct.pack("<i", 10**9)),
            "its free address 1000000000 outside",
        ),
        (lambda path, end: path.write_bytes(path.read_bytes()[: end - 8]), "wanted a whole file"),
        (lambda path, end: changed(path, 88, b"VAX-GFLT"), 'found the format "VAX-GFLT" of numbers'),
    ],
)
def test_damage_is_said_in_one_sentence(tmp_path, damage, message):
    path = orbit(tmp_path / "orbit.bsp", 9, 250)
    damage(path, last_word(path))
    with pytest.raises(InputError) as error:
        require_whole(path, path)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.skipif(not CASES.is_dir(), reason="shared/cases is not beside the checkout")
def test_the_case_of_which_the_interpreter_died():
    with pytest.raises(InputError, match=r"segfault-one-byte\.bsp: found a damaged kernel"):
        read_spk(CASES / "files" / "segfault-one-byte.bsp")


def test_a_span_of_too_many_samples_is_refused(tmp_path):
    path = orbit(tmp_path / "orbit.bsp", 9, 250)
    with pytest.raises(InputError, match="wanted at most 5000000 samples"):
        read_spk(path, step_s=1e-4)
