"""Lines of libraries never reach the user: commands in a process of their own, whose standard error is counted."""

from __future__ import annotations

import pytest

from command import demo, process
from test_foreign_files import dem


@pytest.mark.slow
def test_a_home_without_a_cache_is_not_talked_about(tmp_path, monkeypatch):
    """matplotlib advises where it finds no folder to keep things in."""
    campaign = demo(tmp_path / "demo", "--images", 2)
    for name in ("HOME", "MPLCONFIGDIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, "/dev/null/none")
    done = process("calibrate", campaign, "--quiet")
    assert (done.status, done.out, done.err) == (0, "", "")


@pytest.mark.slow
def test_a_damaged_raster_is_one_line(tmp_path):
    pytest.importorskip("rasterio", reason="needs the extra gis")
    campaign = demo(tmp_path / "demo", "--images", 1)
    bad = tmp_path / "dem.tif"
    for content in (b"II*\0\xff\0\0\0", b"MM\0*" + bytes(200), dem(tmp_path, "5 5 5 no").read_bytes()):
        bad.write_bytes(content)
        pixel = ("--image", "image01", 10, 10)
        done = process("locate", campaign, *pixel, "--dem", bad, "--heights", "ellipsoidal")
        assert done.status == 2
        assert done.err.startswith("starplumb: ")
        assert done.err.count("\n") == 1


def test_what_is_logged_is_printed_by_nobody(capfd):
    import logging

    from starplumb.io.text.libraries import keep_quiet

    keep_quiet("a library")
    keep_quiet("a library")
    logging.getLogger("a library.part").warning("advice")
    assert len(logging.getLogger("a library").handlers) == 1
    assert capfd.readouterr() == ("", "")
