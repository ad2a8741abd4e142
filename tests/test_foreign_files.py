"""Files that once made a program reach beyond them, die or believe nonsense: each is refused in one sentence."""

from __future__ import annotations

import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from command import demo, starplumb
from starplumb.io.formats.oem import read_oem
from starplumb.io.text.pvl import read_pvl
from starplumb.physics.errors import InputError


@pytest.fixture
def requests():
    """The port of a server, and the requests that reach it."""
    seen: list[str] = []

    class Counted(BaseHTTPRequestHandler):
        def do_GET(self):
            seen.append(self.path)
            self.send_error(404)

        do_HEAD = do_GET

        def log_message(self, *_):
            pass

    server = HTTPServer(("127.0.0.1", 0), Counted)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server.server_address[1], seen
    server.shutdown()
    server.server_close()


def one_sentence(done, words):
    assert done.status == 2
    assert words in done.err
    assert done.err.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "words"),
    [("net-crs-url.points", "found the reference system"), ("net-landmarks-vrt-remote.geojson", "not JSON")],
)
def test_a_file_that_names_an_address_asks_nobody(shared_cases, requests, name, words, tmp_path):
    pytest.importorskip("rasterio", reason="needs the extra gis")
    port, seen = requests
    copy = tmp_path / name
    copy.write_text((shared_cases / "files" / name).read_text().replace("18765", str(port)))
    one_sentence(
        starplumb("points", copy, "--out", tmp_path / "out", "--sigma-m", 1, "--sigma-px", 0.5), words
    )
    campaign = demo(tmp_path / "demo", "--images", 1)
    text = campaign.read_text()
    campaign.write_text(text.replace('"landmarks.csv"', f'"{copy}"'))
    assert starplumb("check", campaign).status == 2
    assert not seen
    assert not (tmp_path / "out").exists()


def test_points_outside_their_projection_are_refused(shared_cases, tmp_path):
    pytest.importorskip("rasterio", reason="needs the extra gis")
    points = shared_cases / "files" / "points-outside-projection.points"
    one_sentence(
        starplumb("points", points, "--out", tmp_path / "out"), "found a place that the reference system"
    )


@pytest.mark.parametrize("name", ["cov-nan", "cov-negative", "other-schema"])
def test_a_result_that_is_none_is_not_believed(shared_cases, name, tmp_path):
    campaign = demo(tmp_path / "demo", "--images", 1)
    result = shared_cases / "files" / f"result-{name}.json"
    done = starplumb("locate", campaign, 1, 1, "--image", "image01", "--result", result)
    one_sentence(done, "starplumb-result/1")


def test_digits_of_another_script_are_no_numbers(shared_cases):
    with pytest.raises(
        InputError, match=r"oem-arabic-digits\.oem, line 13: found .*, wanted a finite number"
    ):
        read_oem(shared_cases / "files" / "oem-arabic-digits.oem")


def test_text_of_a_hundred_thousand_lines_is_no_metadata(shared_cases):
    """Read in one go: the pattern that it once was matched against needed minutes."""
    with pytest.raises(InputError, match=r"pvl-redos\.IMD, line 1: found "):
        read_pvl(shared_cases / "files" / "pvl-redos.IMD")
