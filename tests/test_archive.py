"""The archive of a mission: campaigns add up to one solution, nothing counts twice, and nothing gets lost."""

from __future__ import annotations

import gzip
import json
import os
import shutil
import sqlite3
import tracemalloc
from contextlib import closing
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

import starplumb as sp
from command import starplumb
from missions import mission, part, tampered, whole
from starplumb.io.archive import blobs, cells, store
from starplumb.io.archive.rows import Instrument, result_text
from starplumb.io.campaign.write import write_campaign
from starplumb.physics import so3
from starplumb.physics.errors import ArgumentError, InputError
from starplumb.physics.timescales import moment
from starplumb.session.mission.entries import day, instrument_of
from starplumb.session.mission.joint import given_of_these, standing


def saved(path, method="gls"):
    result = sp.calibrate(sp.read_campaign(path), method=method)
    result.save(path.parent / "result", report=False)
    return path.parent / "result"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    campaign = whole(np.random.default_rng(16))
    for name, chosen in {"all": list(range(6)), "a": [0, 1], "b": [2, 3, 4, 5]}.items():
        saved(write_campaign(folder / name, part(campaign, chosen, name)))
    return folder


@pytest.fixture
def parts(made, tmp_path):
    """One campaign of a site, and its images in two campaigns: folders of results."""
    shutil.copytree(made, tmp_path / "made")
    return {name: tmp_path / "made" / name / "result" for name in ("all", "a", "b")}


def archive_of(tmp_path, *results, name="mission.db"):
    found = sp.open_archive(tmp_path / name, create=True)
    found.add([str(one) for one in results])
    return found


def test_campaigns_of_an_archive_are_solved_as_one(tmp_path, parts):
    found = archive_of(tmp_path, parts["a"], parts["b"]).show()
    one = json.loads((parts["all"] / "result.json").read_text())
    away = so3.log(found.C_EK @ np.array(one["mounting"]["matrix"]).T) * 206264.80625
    assert np.all(np.abs(away) < 1e-3 * np.array(one["sigma_arcsec"]))
    np.testing.assert_allclose(found.document["sigma_arcsec"], one["sigma_arcsec"], rtol=1e-3)
    np.testing.assert_allclose(
        found.document["covariance_arcsec2"], one["covariance_arcsec2"], rtol=2e-3, atol=1e-3
    )
    assert found.document["fit"]["chi2"] == pytest.approx(one["fit"]["chi2"], rel=1e-3)
    assert found.document["fit"]["degrees_of_freedom"] == one["fit"]["degrees_of_freedom"]
    assert [c["name"] for c in found.document["campaigns"]] == ["a", "b"]
    assert found.document["landmarks_shared"] == 9


@pytest.mark.slow
def test_the_same_inputs_are_one_entry(tmp_path, parts):
    path = tmp_path / "mission.db"
    assert starplumb("archive", "init", path, "--satellite", "S1").status == 0
    for what in (parts["a"], parts["a"] / "result.json", parts["a"]):
        assert starplumb("archive", "add", path, what).status == 0
    listed = json.loads(starplumb("archive", "list", path, "--json").out)
    assert [(one["name"], one["satellite"], one["images"]) for one in listed] == [("a", "S1", 2)]


@pytest.mark.slow
def test_a_campaign_and_its_result_are_one_entry(tmp_path, parts):
    path = tmp_path / "mission.db"
    saved(parts["a"].parent / "campaign.toml", method="default")
    assert starplumb("archive", "init", path).status == 0
    assert starplumb("archive", "add", path, parts["a"].parent / "campaign.toml", parts["a"]).status == 0
    assert len(json.loads(starplumb("archive", "list", path, "--json").out)) == 1


@pytest.mark.slow
@pytest.mark.parametrize("other", ["another method", "more images"])
def test_sightings_do_not_count_twice(tmp_path, parts, other):
    archive = archive_of(tmp_path, parts["b"])
    if other == "another method":
        saved(parts["b"].parent / "campaign.toml", method="default")
    coming = parts["b"] if other == "another method" else parts["all"]
    with pytest.raises(InputError, match=r"would count twice, wanted .* withdrawn first"):
        archive.add(coming)
    assert len(archive.entries) == 1
    archive.withdraw(archive.entries[0].id[:8], "to be replaced")
    archive.add(coming)
    assert [entry.stands for entry in archive.entries].count(True) == 1


@pytest.mark.slow
def test_one_landmark_stands_at_one_place(tmp_path, parts):
    archive = archive_of(tmp_path, parts["a"])
    table = parts["b"].parent / "landmarks.csv"
    lines = table.read_text().splitlines()
    row = lines[1].split(",")
    row[3] = str(float(row[3]) + 5.0)
    table.write_text("\n".join([lines[0], ",".join(row), *lines[2:]]) + "\n")
    moved = saved(parts["b"].parent / "campaign.toml")
    done = starplumb("archive", "add", archive.path, moved)
    assert done.status == 2
    assert "found landmark[gcp001] 5 m from where" in done.err
    assert done.err.count("\n") == 1


@pytest.mark.slow
def test_what_is_withdrawn_counts_no_more_and_stays(tmp_path, parts):
    archive = archive_of(tmp_path, parts["a"], parts["b"])
    alone = archive_of(tmp_path, parts["b"], name="alone.db").show()
    assert starplumb("archive", "withdraw", archive.path, "a", "--reason", "wrong clock").status == 0
    found = archive.show()
    np.testing.assert_allclose(found.C_EK, alone.C_EK, atol=1e-15)
    assert found.document["left_out"][0]["reason"] == "withdrawn: wrong clock"
    assert len(archive.listed) == 2
    with pytest.raises(InputError, match=r"found it withdrawn \(wrong clock\)"):
        archive.add(parts["a"])


def test_rows_are_only_ever_added(tmp_path, parts):
    archive = archive_of(tmp_path, parts["a"])
    archive.withdraw("a", "a test")
    with closing(sqlite3.connect(archive.path)) as database, database:
        for table in ("campaign", "image", "normal", "unknown", "input", "withdrawn"):
            for statement in (f"DELETE FROM {table}", f"UPDATE {table} SET rowid = rowid"):
                with pytest.raises(sqlite3.IntegrityError, match="only grows"):
                    database.execute(statement)


@pytest.mark.slow
def test_archives_are_united_whatever_the_order(tmp_path, parts):
    one, two = archive_of(tmp_path, parts["a"]), archive_of(tmp_path, parts["b"], name="two.db")
    both = archive_of(tmp_path, parts["a"], parts["b"], name="both.db")
    two.withdraw("b", "a test")
    assert one.merge(two.path)["campaigns"] == 1
    assert one.merge(two.path)["campaigns"] == 0
    two.merge(one.path)
    assert {e.id for e in one.entries} == {e.id for e in two.entries} == {e.id for e in both.entries}
    assert [e.withdrawn is not None for e in one.entries] == [e.withdrawn is not None for e in two.entries]
    assert one.verify()["faults"] == []
    assert one.verify()["not_kept"] == {}


def test_an_archive_is_not_united_with_itself(tmp_path):
    archive = sp.open_archive(tmp_path / "m.db", create=True)
    (tmp_path / "link.db").symlink_to(tmp_path / "m.db")
    for other in ("m.db", "link.db"):
        with pytest.raises(InputError, match=rf"{other}: found the archive itself"):
            archive.merge(tmp_path / other)


@pytest.mark.slow
def test_archives_that_contradict_each_other_are_not_united(tmp_path, parts):
    one, two = archive_of(tmp_path, parts["b"]), archive_of(tmp_path, parts["all"], name="two.db")
    with pytest.raises(InputError, match="would count twice"):
        one.merge(two.path)
    assert len(one.entries) == 1


def test_what_a_killed_addition_leaves_is_told_and_used_by_the_next(tmp_path, parts, monkeypatch):
    archive = sp.open_archive(tmp_path / "m.db", create=True)
    with monkeypatch.context() as patch:
        patch.setattr(sp.Archive, "_insert", lambda *of: 1 / 0)
        patch.setattr(blobs, "drop", lambda *of: None)  # nothing is tidied by a process that is killed
        with pytest.raises(ZeroDivisionError):
            archive.add(parts["a"])
    digests = set(json.loads((parts["a"] / "result.json").read_text())["inputs"].values())
    assert set(archive.verify()["left_over"]) == digests
    said = starplumb("archive", "verify", archive.path).out
    assert f"{len(digests)} files in m.db.files are of no campaign" in " ".join(said.split())
    monkeypatch.setattr(blobs, "_write", lambda *of: 1 / 0)
    archive.add(parts["a"])
    assert (archive.verify()["left_over"], archive.verify()["not_kept"]) == ([], {})


def test_verify_finds_what_was_changed(tmp_path, parts):
    archive = archive_of(tmp_path, parts["a"])
    digest = next(iter(json.loads((parts["a"] / "result.json").read_text())["inputs"].values()))
    blobs.place_of(archive.path, digest).write_bytes(b"no longer")
    assert list(archive.verify()["not_kept"].values()) == [["campaign.toml"]]
    with tampered(archive.path) as database:
        database.execute("UPDATE input SET sha256 = 'sha256:0' WHERE name = 'campaign.toml'")
    done = starplumb("archive", "verify", archive.path)
    assert done.status == 3
    assert "is not what its id says" in done.err


@pytest.mark.slow
def test_the_scatter_of_campaigns_tells_its_own_sigma(rng, tmp_path):
    """Six campaigns of a mounting that jumps by 20 arcsec rms between them: no stated sigma knows of it."""
    jumps = rng.normal(0.0, 20.0, (6, 3))
    paths = mission(rng, tmp_path, [10.0 * k for k in range(6)], jumps)
    found = archive_of(tmp_path, *map(saved, paths)).show().document
    assert found["status"] == "weak"
    assert "the mounting may move" in found["message"]
    wanted = np.std(jumps, axis=0, ddof=1) / np.sqrt(6)
    assert np.all(np.array(found["sigma_from_data_arcsec"]) > 0.5 * wanted)
    assert np.all(np.array(found["interval_95_arcsec"]) > 2.0 * wanted)


@pytest.mark.parametrize("length", [None, 3000.0])
def test_neighbours_on_the_ground_are_said_to_count_as_independent(rng, tmp_path, length):
    """Between campaigns nothing knows that two landmarks stand side by side."""
    paths = mission(rng, tmp_path, [0.0, 30.0], images=2)
    for path in paths:
        text = path.read_text()
        assert "\n[landmarks]\n" in text
        if length is not None:
            path.write_text(text.replace("[landmarks]", f"[landmarks]\ncorrelation_length_m = {length}", 1))
    found = archive_of(tmp_path, *map(saved, paths)).show().document
    assert ("correlation_length_m" in found["message"]) == (length is not None)


def foreign_database(path):
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE t(x)")


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda path: None, "found no such file, wanted an archive"),
        (lambda path: path.mkdir(), "found a folder, wanted an archive"),
        (os.mkfifo, "found a pipe, wanted an archive"),
        (lambda path: path.write_text("no database at all " * 9), "found a file that SQLite cannot read"),
        (
            lambda path: foreign_database(path),
            "found a database of another program",
        ),
    ],
)
@pytest.mark.parametrize("verb", ["list", "show", "verify"])
def test_what_is_no_archive_is_refused_in_a_sentence(tmp_path, make, sentence, verb):
    make(tmp_path / "x.db")
    done = starplumb("archive", verb, tmp_path / "x.db", "--json")
    assert (done.status, done.out) == (2, "")
    assert sentence in done.err
    assert done.err.count("\n") == 1


def test_a_pipe_is_no_archive_and_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    assert not store.is_archive(tmp_path / "pipe")


def test_an_archive_is_never_overwritten(tmp_path):
    assert starplumb("archive", "init", tmp_path / "x.db").status == 0
    done = starplumb("archive", "init", tmp_path / "x.db")
    assert done.status == 2
    assert "an archive is never overwritten" in done.err
    assert [path.name for path in tmp_path.iterdir()] == ["x.db"]


MOUNTS = """\
22 1 8:1 / / rw,relatime - ext4 /dev/sda1 rw
30 22 0:40 / /mnt/team rw,relatime shared:1 - nfs4 server:/team rw
31 30 0:41 / /mnt/team/my\\040disk rw - xfs /dev/sdb1 rw
"""


@pytest.mark.parametrize(
    ("folder", "kind"),
    [
        ("/srv/u", "ext4"),
        ("/mnt/team", "nfs4"),
        ("/mnt/team/a/b", "nfs4"),
        ("/mnt/team/my disk/a", "xfs"),
        ("/mnt/teamwork", "ext4"),
    ],
)
def test_the_kind_of_a_drive_is_that_of_its_nearest_mount(folder, kind):
    assert store.kind_of_drive(Path(folder), MOUNTS) == kind


def test_network_drives_are_refused_in_a_sentence(tmp_path, monkeypatch):
    listed = tmp_path / "mounts"
    listed.write_text(f"30 22 0:40 / {tmp_path} rw - nfs4 server:/team rw\n")
    monkeypatch.setattr(store, "MOUNTS", listed)
    done = starplumb("archive", "init", tmp_path / "x.db")
    assert done.status == 2
    assert "found a network drive (nfs4), wanted a local one" in done.err
    assert not (tmp_path / "x.db").exists()


def test_several_satellites_are_told_apart(tmp_path, parts):
    archive = sp.open_archive(tmp_path / "fleet.db", create=True)
    archive.add(parts["a"], satellite="A")
    archive.add(parts["b"], satellite="B")
    assert archive.show("A").document["satellite"] == "A"
    with pytest.raises(
        InputError, match=r"satellite: found several mountings in .*'A', camera to star_tracker"
    ):
        archive.show()
    with pytest.raises(InputError, match="satellite: found 'C'"):
        archive.show("C")


def test_several_cameras_are_told_apart_by_their_names():
    two = [Instrument("S", camera, "star_tracker") for camera in "AB"]
    with pytest.raises(ArgumentError, match="found several mountings") as said:
        instrument_of("mission.db", two, two, None, None)
    assert said.value.argument == "camera"
    assert instrument_of("mission.db", two[:1], two, None, None) == two[0]


def test_a_time_is_shown_to_the_second_in_which_it_lies():
    """As the other verbs cut it."""
    assert day(moment("2026-03-20T09:59:44.700", "UTC")) == "2026-03-20T09:59:44"


def test_equations_of_another_result_are_refused(tmp_path, parts):
    """Of a result of the first edition, which names no digests: no others would be read at all."""
    (parts["a"] / "normals.json").write_text((parts["b"] / "normals.json").read_text())
    result = json.loads((parts["a"] / "result.json").read_text())
    del result["files"]
    (parts["a"] / "result.json").write_text(json.dumps(result))
    with pytest.raises(InputError, match=r"equations about another mounting than that of result\.json"):
        archive_of(tmp_path, parts["a"])


def test_equations_that_were_changed_or_lost_since_are_refused(tmp_path, parts):
    archive = sp.open_archive(tmp_path / "m.db", create=True)
    folder = tmp_path / "copy"
    shutil.copytree(parts["a"], folder)
    text = (folder / "normals.json").read_text()
    (folder / "normals.json").write_text(f"{text} ")
    with pytest.raises(InputError, match=r"result\.json: found normals\.json changed since"):
        archive.add(folder)
    (folder / "normals.json").unlink()
    with pytest.raises(InputError, match=r"result\.json: found normals\.json no longer beside it"):
        archive.add(folder)
    (folder / "normals.json").write_text(text)
    assert archive.add(folder)["campaigns"][0]["new"]


@pytest.mark.slow
def test_the_past_is_repeated_from_the_kept_files(tmp_path, parts):
    """The campaigns' own files are gone; the archive still says what today's program makes of them."""
    result = sp.calibrate(sp.read_campaign(parts["a"].parent / "campaign.toml"), ["time_offset=10ms"], "gls")
    result.save(parts["a"], report=False)
    archive = archive_of(tmp_path, parts["a"], parts["b"])
    shutil.rmtree(tmp_path / "made")
    done = json.loads(starplumb("archive", "rerun", archive.path, "--json").out)
    assert [one["name"] for one in done["campaigns"]] == ["a", "b"]
    assert not any(one["changed"] for one in done["campaigns"])
    assert all(abs(s) < 1e-6 for one in done["campaigns"] for s in one["change_sigmas"])


def test_a_campaign_whose_images_are_gone_is_a_damaged_archive(tmp_path, parts):
    archive = archive_of(tmp_path, parts["a"])
    with tampered(archive.path) as database:
        database.execute("DELETE FROM image")
    done = starplumb("archive", "trend", archive.path)
    assert done.status == 2
    assert 'found a damaged archive ("a campaign without its images")' in done.err


ISSUED = (
    "INSERT INTO validity SELECT 'v', satellite, frame_from, frame_to, {from_ns}, NULL, '{model}', '', NULL, '' "
    "FROM campaign"
)


@pytest.mark.parametrize(
    ("verb", "change"),
    [
        ("trend", ISSUED.format(from_ns=0, model="{}")),
        ("trend", ISSUED.format(from_ns=0, model='{"time": 3, "year_time": "2000-01-01T00:00:00"}')),
        ("trend", ISSUED.format(from_ns=2**62, model="{}")),
        ("trend", "UPDATE image SET temperatures_json = '1.5'"),
        ("trend", """UPDATE image SET temperatures_json = '{"plate": "warm"}'"""),
        ("trend", "UPDATE image SET t_ns = -(1 << 62) + rowid"),
        ("list", "UPDATE campaign SET first_ns = 1 << 62"),
        ("trend", "UPDATE image SET u_rad = 9e999"),
        ("list", "UPDATE campaign SET options_json = '[]'"),
        ("show", "UPDATE normal SET names_json = '7'"),
        ("trend", "INSERT INTO event SELECT 'e', satellite, 1 << 62, '', '', '' FROM campaign"),
    ],
)
def test_rows_that_hold_something_else_are_a_damaged_archive(tmp_path, parts, verb, change):
    archive = archive_of(tmp_path, parts["a"])
    with tampered(archive.path) as database:
        database.execute(change)
    done = starplumb("archive", verb, archive.path)
    assert done.status == 2
    assert f"{archive.path}: found a damaged archive (" in done.err


def test_a_time_that_is_missing_is_told():
    with pytest.raises(ValueError, match="a time that is no whole number"):
        cells.epoch(None)


def test_a_result_that_an_index_has_and_its_table_has_not_is_told(tmp_path, parts):
    archive = archive_of(tmp_path, parts["a"])
    with (
        closing(sqlite3.connect(archive.path)) as database,
        pytest.raises(ValueError, match="a campaign without its result"),
    ):
        result_text(database, "sha256:0")


@pytest.mark.slow
def test_a_change_of_an_answer_is_said(tmp_path, parts):
    archive = archive_of(tmp_path, parts["a"])
    with tampered(archive.path) as database:
        turned = so3.exp([1e-4, 0.0, 0.0]) @ np.array(
            json.loads((parts["a"] / "result.json").read_text())["mounting"]["matrix"]
        )
        database.execute("UPDATE campaign SET matrix = ?", (turned.astype("<f8").tobytes(),))
    (one,) = archive.rerun()["campaigns"]
    assert one["changed"]
    assert one["change_arcsec"][0] == pytest.approx(-1e-4 * 206264.806, rel=1e-6)


def test_what_is_not_kept_is_not_run(tmp_path, parts):
    archive = archive_of(tmp_path, parts["a"])
    shutil.rmtree(blobs.folder_of(archive.path))
    done = archive.rerun()
    assert done["campaigns"] == []
    assert done["not_run"][0]["reason"] == "campaign.toml is not kept"


def test_a_pipe_among_the_kept_files_is_not_waited_for(tmp_path, parts):
    archive = archive_of(tmp_path, parts["a"])
    digest = next(iter(json.loads((parts["a"] / "result.json").read_text())["inputs"].values()))
    place = blobs.place_of(archive.path, digest)
    place.unlink()
    os.mkfifo(place)
    assert list(archive.verify()["not_kept"].values()) == [["campaign.toml"]]
    assert archive.rerun()["not_run"][0]["reason"] == "campaign.toml is not kept"
    (tmp_path / "other.db.files").mkdir()
    assert not blobs.keep(tmp_path / "other.db", digest, place)


def test_a_kept_file_that_grows_without_end_is_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(blobs, "MOST_BYTES", 3 * blobs.PIECE)
    digest = f"sha256:{sha256(bytes(30 * blobs.PIECE)).hexdigest()}"
    place = blobs.place_of(tmp_path / "mission.db", digest)
    place.parent.mkdir(parents=True)
    place.write_bytes(gzip.compress(bytes(30 * blobs.PIECE)))
    tracemalloc.start()
    assert not blobs.is_kept(tmp_path / "mission.db", digest)
    assert tracemalloc.get_traced_memory()[1] < 8 * blobs.PIECE
    tracemalloc.stop()
    monkeypatch.setattr(blobs, "MOST_BYTES", 30 * blobs.PIECE)
    assert blobs.is_kept(tmp_path / "mission.db", digest)
    place.write_bytes(place.read_bytes()[:40] + b"\xff" * 40)
    assert not blobs.is_kept(tmp_path / "mission.db", digest)


def test_a_full_disk_leaves_no_kept_files(tmp_path, parts, monkeypatch):
    archive = archive_of(tmp_path)

    def refusing(*_):
        raise sqlite3.OperationalError("disk I/O error")

    def full(*_):
        raise sqlite3.OperationalError("database or disk is full")

    monkeypatch.setattr(type(archive), "_insert", staticmethod(full))
    with pytest.raises(InputError, match="found the disk full, wanted room; nothing was added"):
        archive.add(str(parts["a"]))
    monkeypatch.setattr(type(archive), "_insert", staticmethod(refusing))
    with pytest.raises(
        InputError, match=r"found that the disk refuses \(disk I/O error\), wanted room on a sound"
    ):
        archive.add(str(parts["a"]))
    assert not blobs.folder_of(archive.path).exists()
    monkeypatch.undo()
    archive.add(str(parts["a"]))
    kept = sorted(blobs.folder_of(archive.path).rglob("*.gz"))
    monkeypatch.setattr(type(archive), "_insert", staticmethod(full))
    with pytest.raises(InputError, match="nothing was added"):
        archive.add([str(parts["a"]), str(parts["b"])])
    assert sorted(blobs.folder_of(archive.path).rglob("*.gz")) == kept


def test_an_archive_is_no_result(tmp_path):
    archive = archive_of(tmp_path)
    with pytest.raises(InputError, match="found an SQLite database, as archives are, wanted UTF-8 text"):
        archive.add(str(archive.path))


@pytest.mark.slow
def test_a_campaign_and_the_prior_of_a_later_one_count_once(rng, tmp_path):
    """The later one has it with a covariance that grew by then; in an archive of both it is left out, and so it is when
    the earlier one is withdrawn."""
    first, later = mission(rng, tmp_path, [0.0, 30.0])
    sp.calibrate(sp.read_campaign(first)).save(first.parent / "result", report=False)
    prior = first.parent / "result"
    with_it, without = (sp.calibrate(sp.read_campaign(later), prior=given) for given in (prior, None))
    sums, by_file, alone = [], [], []
    for name, second in (("with", with_it), ("without", without)):
        archive = sp.open_archive(tmp_path / f"{name}.db", create=True)
        archive.add(first.parent / "result")
        archive.add(second)
        sums.append(archive.show().document)
        with store.opened(archive.path) as database:
            used = standing(name, database, archive.entries[0].instrument).entries
            by_file.append(given_of_these(database, used[1:], used))
        archive.withdraw(used[0].id, "wrong markers")
        alone.append(archive.show().document)
    assert by_file == [
        True,
        False,
    ]  # where a mounting moves, its file alone tells that the prior is of the other
    assert "what campaigns state of the mounting beforehand is left out" in sums[0]["message"]
    assert sums[0]["sigma_arcsec"] == pytest.approx(sums[1]["sigma_arcsec"], rel=1e-6)
    assert "it is that of a campaign that is withdrawn" in alone[0]["message"]
    assert alone[0]["sigma_arcsec"] == pytest.approx(without.document["sigma_arcsec"], rel=1e-3)
    assert alone[1]["status"] == "ok"
