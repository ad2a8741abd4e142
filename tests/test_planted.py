"""Folders that came from elsewhere: whatever somebody has put where starplumb keeps its own is told from its own."""

from __future__ import annotations

import json
import os
import tracemalloc

import numpy as np
import pytest

from starplumb.disk import arrays, parts
from starplumb.disk.arrays import read_arrays, write_arrays
from starplumb.disk.owned import require_replaceable
from starplumb.disk.parts import half_placed
from starplumb.disk.publish import publish_beside
from starplumb.disk.staging import staged
from starplumb.io.archive import blobs
from starplumb.io.imagery.kept import LAYOUT, KeptImages
from starplumb.io.text.files import fingerprint
from starplumb.io.vendors import metadata_files
from starplumb.physics.errors import InputError
from starplumb.study.store import Store

MARK = ("result.json", "starplumb-result/1")
GONE = 2**22 + 1
"""No process of this machine has such a number."""


def unfinished(folder):
    """The name of a folder that a process of this machine, now gone, might have left."""
    return folder / f".starplumb-{parts._machine()}-{GONE}-0.part"


def sparse(path):
    """Eight gigabytes of nothing."""
    with path.open("wb") as file:
        file.truncate(8 << 30)


def nested(path):
    path.write_text("[" * 100_000)


def many(path):
    path.write_text("[" + "0," * 3_100_000 + "0]")


def other(path):
    path.write_text('{"schema": ["starplumb-result/1"], "files": "all"}')


def text(path):
    path.write_bytes(b"\xff\xfe")


PLANTED = (sparse, os.mkfifo, nested, many, other, text, os.mkdir)


@pytest.mark.parametrize("plant", PLANTED)
def test_a_mark_that_is_none_is_not_replaced(tmp_path, plant):
    plant(tmp_path / "result.json")
    tracemalloc.start()
    with pytest.raises(
        InputError, match=r"result\.json: found a file that is not of an earlier result\.json there"
    ):
        require_replaceable(tmp_path, ["result.json"], mark=MARK)
    assert tracemalloc.get_traced_memory()[1] < 2e7
    tracemalloc.stop()


@pytest.mark.parametrize("plant", [plant for plant in PLANTED if plant is not other])
def test_a_study_that_is_none_is_not_gone_on_with(tmp_path, plant):
    plant(tmp_path / "study.json")
    with pytest.raises(InputError, match=r"study\.json: found it damaged"):
        Store.open(tmp_path, None)


@pytest.mark.parametrize("plant", PLANTED)
def test_an_order_that_is_none_has_nothing_put_in_place(tmp_path, plant):
    part = unfinished(tmp_path)
    part.mkdir()
    plant(part / parts.ORDER)
    assert half_placed(tmp_path) is None


@pytest.mark.parametrize(
    "names",
    [["../x", "a"], ["/etc/x", "a"], ["", "a"], [["x"], "a"], {"x": 1, "a": 2}, ["a", ".."], [".", "a"]],
)
def test_an_order_of_files_elsewhere_has_nothing_put_in_place(tmp_path, names):
    part = unfinished(tmp_path)
    part.mkdir()
    (part / "a").write_text("")
    (part / parts.ORDER).write_text(json.dumps(names))
    assert half_placed(tmp_path) is None


def test_a_link_in_the_place_of_unfinished_work_is_not_followed(tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    for name in ("result.json", "precious.txt"):
        (elsewhere / name).write_text("mine")
    folder = tmp_path / "out"
    folder.mkdir()
    unfinished(folder).symlink_to(elsewhere)
    with staged(folder, keep="result.json") as staging:
        staging.write("a.txt", [b"a"])
        staging.commit(["a.txt"])
    assert sorted(path.name for path in elsewhere.iterdir()) == ["precious.txt", "result.json"]


def test_a_large_file_of_a_users_own_is_not_read_to_be_compared(tmp_path):
    sparse(tmp_path / "landmarks.csv")
    with pytest.raises(InputError, match=r"landmarks\.csv: found a file that holds something else"):
        publish_beside(tmp_path, {"landmarks.csv": "a"})


def packed(path):
    """A few kilobytes that unpack to a hundred megabytes."""
    np.savez_compressed(path, a=np.zeros(12_500_000))


def one_array(path):
    with path.open("wb") as file:
        np.save(file, np.zeros(3))


def without_digest(path):
    np.savez(path, a=np.zeros(3))


def objects(path):
    np.savez(path, a=np.array([{}], dtype=object), digest=np.array("x"))


@pytest.mark.parametrize("plant", [*PLANTED, packed, one_array, without_digest, objects])
def test_arrays_that_are_none_of_ours_are_not_taken(tmp_path, plant):
    plant(tmp_path / "a.npz")
    tracemalloc.start()
    assert read_arrays(tmp_path / "a.npz", "about") is None
    assert tracemalloc.get_traced_memory()[1] < 2e7
    tracemalloc.stop()


@pytest.mark.parametrize(
    "layout",
    ["3", "[]", "{", "[" * 100_000, '{"array": 7}', '{"kind": "Path", "of": {}}', '{"kind": [], "of": 3}'],
)
def test_a_kept_image_that_is_another_thing_is_measured_again(tmp_path, layout):
    kept = KeptImages.beside(tmp_path / "out", "about")
    kept.folder.mkdir()
    write_arrays(kept.folder / "image.npz", {LAYOUT: np.array(layout)}, kept._about("image"))
    assert arrays.read_arrays(kept.folder / "image.npz", kept._about("image")) is not None
    assert kept.recall("image") in (None, 3, [])


def test_a_file_beyond_what_is_kept_is_not_read(tmp_path, monkeypatch):
    path = tmp_path / "a.csv"
    path.write_bytes(b"12345")
    archive = tmp_path / "mission.db"
    monkeypatch.setattr(blobs, "MOST_BYTES", 4)
    assert not blobs.keep(archive, fingerprint(path), path)
    monkeypatch.setattr(blobs, "MOST_BYTES", 5)
    assert blobs.keep(archive, fingerprint(path), path)
    assert b"".join(blobs.pieces(archive, fingerprint(path))) == b"12345"


def test_metadata_too_large_to_be_read_are_told_where_they_are_read(tmp_path, monkeypatch):
    path = tmp_path / "a.xml"
    path.write_text("<isd>" + " " * 100)
    assert not metadata_files._describes_an_image(path)
    monkeypatch.setattr(metadata_files, "MOST_TEXT", 50)
    assert metadata_files._describes_an_image(path)
