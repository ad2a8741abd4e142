"""What is written: all of a set or none of it, never over what was read or is not ours, and nothing left behind."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from starplumb.disk import staging
from starplumb.disk.interruption import Stopped, stop_as_by_ctrl_c, uninterrupted
from starplumb.disk.owned import Mark, require_own
from starplumb.disk.parts import _machine, half_placed, note_order
from starplumb.disk.publish import publish, publish_beside, unlike
from starplumb.io.campaign.read import load_campaign
from starplumb.physics.errors import InputError

KIND = "starplumb-test/1"


def mark(**more):
    return Mark("set.json", KIND, lambda files: json.dumps({"schema": KIND, "files": files, **more}))


def holds(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8")
        for path in folder.rglob("*")
        if path.is_file()
    }


def sha256(text):
    return "sha256:" + hashlib.sha256(text.encode()).hexdigest()


def test_the_mark_names_every_other_file_with_its_digest(tmp_path):
    publish(tmp_path / "new", {"a": "one", "b": lambda path: path.write_text("two")}, mark=mark())
    found = holds(tmp_path / "new")
    assert json.loads(found.pop("set.json"))["files"] == {"a": sha256("one"), "b": sha256("two")}
    assert found == {"a": "one", "b": "two"}


@pytest.mark.parametrize("step", range(6))
def test_a_set_cut_off_at_any_step_is_old_or_told_by_its_mark(tmp_path, monkeypatch, step):
    """The disk fails at the n-th rename, removal or flush: as long as the mark is the old one nothing else counts."""
    publish(tmp_path, {"a": "old a", "b": "old b"}, mark=mark(of="old"))
    calls = iter(range(100))

    def failing(real):
        def call(*arguments, **keywords):
            if next(calls) == step:
                raise OSError(errno.EIO, "Input/output error")
            return real(*arguments, **keywords)

        return call

    with monkeypatch.context() as broken:
        broken.setattr(staging.Path, "replace", failing(staging.Path.replace))
        broken.setattr(staging, "flush", failing(staging.flush))
        with pytest.raises(InputError, match="found no way to write there"):
            publish(tmp_path, {"a": "new a", "b": "new b"}, mark=mark(of="new"))
    found = holds(tmp_path)
    assert set(found) == {"a", "b", "set.json"}
    assert json.loads(found["set.json"])["of"] == "old"
    if step < 4:  # the three files and the folder are flushed first
        assert found["a"] == "old a"
    publish(tmp_path, {"a": "new a", "b": "new b"}, mark=mark(of="new"))
    assert json.loads(holds(tmp_path)["set.json"])["files"] == {"a": sha256("new a"), "b": sha256("new b")}


def test_a_new_folder_appears_as_a_whole(tmp_path, monkeypatch):
    seen = []
    real = staging.Path.rename

    def watched(self, target):
        seen.append(sorted(holds(tmp_path)))
        assert not (tmp_path / "far").exists()
        return real(self, target)

    monkeypatch.setattr(staging.Path, "rename", watched)
    publish(tmp_path / "far" / "away", {"a": "one", "b": "two"})
    assert len(seen) == 1
    assert holds(tmp_path) == {"far/away/a": "one", "far/away/b": "two"}


def test_two_processes_may_make_the_same_folder(tmp_path):
    def meanwhile(path):
        publish(tmp_path / "new", {"c": "theirs"})
        path.write_text("mine")

    publish(tmp_path / "new", {"a": meanwhile})
    assert holds(tmp_path) == {"new/a": "mine", "new/c": "theirs"}


@pytest.mark.parametrize("kind", ["itself", "link", "hard link", "through a folder"])
def test_no_file_that_is_read_is_replaced(tmp_path, kind):
    folder, read = tmp_path / "out", tmp_path / "input.csv"
    folder.mkdir()
    if kind == "itself":
        read = folder / "a"
    read.write_text("mine")
    if kind == "link":
        (folder / "a").symlink_to(read)
    elif kind == "hard link":
        (folder / "a").hardlink_to(read)
    elif kind == "through a folder":
        read.rename(folder / "a")
        (tmp_path / "other").symlink_to(folder)
        read = tmp_path / "other" / "a"
    with pytest.raises(InputError, match=r"a: found a file that is read here"):
        publish(folder, {"a": "new"}, inputs=[read])
    assert read.read_text() == "mine"
    assert not list(tmp_path.rglob(".*"))


def test_only_what_the_mark_names_is_replaced_or_removed(tmp_path):
    (tmp_path / "a").write_text("a user's own")
    with pytest.raises(InputError, match=r"a: found a file that is not of an earlier set\.json there"):
        publish(tmp_path, {"a": "new"}, mark=mark())
    assert holds(tmp_path) == {"a": "a user's own"}
    (tmp_path / "a").unlink()
    publish(tmp_path, {"a": "one", "b": "two"}, ["b", "c"], mark=mark())
    (tmp_path / "c").write_text("a user's own")
    publish(tmp_path, {"a": "three"}, ["b", "c"], mark=mark())
    found = holds(tmp_path)
    assert set(found) == {"a", "c", "set.json"}
    assert (found["a"], found["c"]) == ("three", "a user's own")


@pytest.mark.parametrize(
    "text", ["", "[]", "{", '{"schema": "other/1"}', '{"schema": 3}', "\ufeff\ud7ff", "[" * 9999]
)
def test_a_mark_of_somebody_else_is_not_replaced(tmp_path, text):
    (tmp_path / "set.json").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"set\.json: found a file that is not of an earlier set\.json"):
        publish(tmp_path, {}, mark=mark())
    assert holds(tmp_path) == {"set.json": text}


def test_a_set_of_the_first_edition_which_names_no_files_is_ours(tmp_path):
    (tmp_path / "set.json").write_text(json.dumps({"schema": "starplumb-test/0"}))
    (tmp_path / "a").write_text("old")
    publish(tmp_path, {"a": "new"}, mark=mark())
    assert holds(tmp_path)["a"] == "new"


KILLED = """
import os, signal, sys
from pathlib import Path
from starplumb.disk import staging
from starplumb.disk.publish import publish
from test_disk import mark

left = int(sys.argv[2])
def dying(real):
    def call(*arguments):
        global left
        left -= 1
        if left < 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return real(*arguments)
    return call
staging.Path.replace = dying(staging.Path.replace)
publish(Path(sys.argv[1]), {"a": "new a", "b": "new b"}, mark=mark(of="new"))
"""


@pytest.mark.slow
@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("renames", [0, 1, 2])
def test_what_a_killed_process_left_is_told_and_then_removed(tmp_path, old, renames):
    """Whatever the moment: the mark is not yet the new one; the next run replaces all and removes the rest."""
    (tmp_path / "there").write_text("so that the folder is not new")
    if old:
        publish(tmp_path, {"a": "old a", "b": "old b"}, mark=mark(of="old"))
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([*sys.path, str(Path(__file__).parent)])}
    done = subprocess.run(
        [sys.executable, "-c", KILLED, tmp_path, str(renames)], env=environment, check=False
    )
    assert done.returncode == -signal.SIGKILL
    assert len(list(tmp_path.glob(".starplumb-*.part"))) == 1
    found = holds(tmp_path)
    assert ("set.json" in found) is old
    if old:
        assert json.loads(found["set.json"])["of"] == "old"
        assert (found["a"] == "old a") is (renames == 0)
    with pytest.raises(InputError):  # a run that fails does not lose track of what is ours
        publish(tmp_path, {"a": "x", "there": "y"}, mark=mark())
    publish(tmp_path, {"a": "newer a", "b": "newer b"}, mark=mark(of="newer"))
    assert set(holds(tmp_path)) == {"a", "b", "there", "set.json"}
    assert not list(tmp_path.glob(".*"))


def test_a_set_that_a_killed_process_had_begun_to_rename_is_told_and_completed(tmp_path):
    """As import --into leaves it, whose files have no mark: the first of three is in place."""
    for name, text in (("a.csv", "new a"), ("b.csv", "old b"), ("campaign.toml", "old")):
        (tmp_path / name).write_text(text)
    part = tmp_path / f".starplumb-{_machine()}-{2**22 + 1}-0.part"
    part.mkdir()
    for name in ("b.csv", "campaign.toml"):
        (part / name).write_text(f"new {name}")
    assert half_placed(tmp_path) is None  # it was killed before: nothing says that a rename had begun
    note_order(part, ["a.csv", "b.csv", "campaign.toml"])
    with pytest.raises(InputError, match=r"campaign\.toml: found files that a killed command had begun"):
        load_campaign(tmp_path / "campaign.toml")
    assert staging.completed(tmp_path)
    assert holds(tmp_path) == {"a.csv": "new a", "b.csv": "new b.csv", "campaign.toml": "new campaign.toml"}
    assert not staging.completed(tmp_path)


def test_a_note_of_a_set_whose_first_file_waits_or_whose_last_is_in_place_says_nothing(tmp_path):
    part = tmp_path / f".starplumb-{_machine()}-{2**22 + 1}-0.part"
    part.mkdir()
    note_order(part, ["a.csv", "campaign.toml"])
    assert half_placed(tmp_path) is None  # all are in place
    for name in ("a.csv", "campaign.toml"):
        (part / name).write_text("new")
    assert half_placed(tmp_path) is None  # none is
    (part / "a.csv").unlink()
    assert half_placed(tmp_path) == (part, ["a.csv", "campaign.toml"])
    note_order(part, ["../a.csv", "campaign.toml"])
    assert half_placed(tmp_path) is None
    (part / ".order").write_text("{")
    assert half_placed(tmp_path) is None


def test_what_is_not_as_its_mark_says_is_told(tmp_path):
    publish(tmp_path, {"a": "one", "b": "two"}, mark=mark())
    files = json.loads((tmp_path / "set.json").read_text())["files"]
    assert unlike(tmp_path, files, ["a", "b", "c"]) == []
    (tmp_path / "a").write_text("other")
    (tmp_path / "b").unlink()
    assert unlike(tmp_path, files, ["b", "a"]) == ["b", "a"]
    assert unlike(tmp_path, None, ["a"]) == []


def test_the_unfinished_work_of_a_living_process_stays(tmp_path):
    with staging.staged(tmp_path) as other:
        other.write("a", [b"not yet"])
        publish(tmp_path, {"b": "two"})
        assert other.path("a").exists()
    assert holds(tmp_path) == {"b": "two"}


def test_beside_a_users_files_only_the_very_same_text_counts_as_written(tmp_path):
    publish_beside(tmp_path, {"a": "one"})
    publish_beside(tmp_path, {"a": "one", "b": "two"})
    with pytest.raises(InputError, match="b: found a file that holds something else"):
        publish_beside(tmp_path, {"b": "three"})
    with pytest.raises(InputError, match="a: found a file that is read here"):
        publish_beside(tmp_path, {"a": "one"}, [tmp_path / "a"])
    assert holds(tmp_path) == {"a": "one", "b": "two"}


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_being_asked_to_stop_is_as_ctrl_c_but_waits_for_the_renames(name):
    number = getattr(signal, name)
    before = signal.getsignal(number)
    try:
        signal.signal(number, signal.SIG_DFL)
        stop_as_by_ctrl_c()
        done = []

        def renames():
            with uninterrupted():
                os.kill(os.getpid(), number)
                done.append("renamed")
            done.append("not reached")

        with pytest.raises(Stopped) as stopped:
            renames()
        assert done == ["renamed"]
        assert isinstance(stopped.value, KeyboardInterrupt)
        assert stopped.value.number == number
        signal.signal(number, signal.SIG_IGN)  # as under nohup
        stop_as_by_ctrl_c()
        assert signal.getsignal(number) is signal.SIG_IGN
    finally:
        signal.signal(number, before)


def test_a_name_that_is_no_utf_8_is_written_as_json_has_it(tmp_path):
    name = os.fsdecode(b"f\xff")
    publish(tmp_path, {"a.json": json.dumps({"name": name}, ensure_ascii=False)})
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == {"name": name}


def test_names_that_gdal_takes_for_memory_are_no_places(tmp_path):
    for place in ("/vsimem", "/vsizip/a.zip", "/VSICURL/http:"):
        with pytest.raises(InputError, match=r"found a name of GDAL's own \(/vsi...\), wanted one of a file"):
            publish(Path(place), {"a.txt": "a"})
        with pytest.raises(InputError, match="found a name of GDAL's own"):
            require_own(Path(place) / "x.tif", [], lambda _: True)
    publish(tmp_path / "vsimem", {"a.txt": "a"})
