"""Archives that somebody has changed: nothing of theirs is run, and ``verify`` names every row that is another."""

from __future__ import annotations

import gzip
import html
import json
import os
import re
import shutil
import sqlite3
import tempfile
from contextlib import closing, contextmanager
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import starplumb as sp
from command import starplumb
from missions import mission, tampered
from starplumb.io.archive import blobs, cells, form, seals, store
from starplumb.io.archive.schema import NAMES, statements
from starplumb.physics.errors import InputError


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """An archive with a row or more in every table."""
    folder = tmp_path_factory.mktemp("made")
    archive = sp.open_archive(folder / "mission.db", create=True, satellite="SAT1")
    for path in mission(np.random.default_rng(7), folder, [0.0, 40.0, 80.0]):
        result = sp.calibrate(sp.read_campaign(path), method="gls")
        result.save(path.parent, report=False)
        archive.add(path.parent)
    archive.withdraw("day 40", "wrong clock table")
    archive.event("2020-01-21T00:00:00", "safe mode", "a note")
    archive.issue("first")
    return archive


@pytest.fixture
def archive(made, tmp_path):
    """A copy without the kept files, for a test to change."""
    with closing(sqlite3.connect(made.path)) as database:
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    shutil.copy(made.path, tmp_path / "mission.db")
    return sp.open_archive(tmp_path / "mission.db")


def columns():
    """Every column of every table, with its type."""
    with closing(sqlite3.connect(":memory:")) as database:
        database.executescript(statements())
        for table in ("meta", *NAMES):
            for row in database.execute(f"PRAGMA table_info({table})").fetchall():
                yield table, row[1], row[2]


def another(value, kind):
    """Nearly the same: another last letter, a number one further, another last bit."""
    if value is None:
        return {"TEXT": "x", "INTEGER": 1, "REAL": 1.0, "BLOB": b"x"}[kind]
    if kind == "TEXT":
        return value[:-1] + ("y" if value.endswith("x") else "x")
    if kind == "BLOB":
        return value[:-1] + bytes([value[-1] ^ 1])
    return value + 1 if kind == "INTEGER" else float(np.nextafter(value, np.inf))


def faults(archive):
    return archive.verify()["faults"]


def test_an_archive_that_nobody_has_changed_has_no_faults(made, archive):
    assert made.verify() | {"archive": ""} == {
        "schema": "starplumb-archive-verify/1",
        "archive": "",
        "campaigns": 3,
        "faults": [],
        "not_kept": {},
        "left_over": [],
    }
    assert faults(archive) == []


def test_every_cell_that_is_changed_is_named(made, tmp_path):
    """One cell of each column of each table, one after the other."""
    data, path, silent = made.path.read_bytes(), tmp_path / "mission.db", []
    for table, column, kind in columns():
        path.write_bytes(data)
        with tampered(path) as database:
            asked = f"SELECT rowid, {column}, * FROM {table} ORDER BY {column} IS NULL, rowid LIMIT 1"
            rowid, value, *cells = database.execute(asked).fetchone()
            change = f"UPDATE {table} SET {column} = ? WHERE rowid = {rowid}"
            database.execute(change, (another(value, kind),))
        name = table if table in ("satellite", "instrument") else cells[0][:12]
        if not any(name in fault for fault in faults(sp.open_archive(path))):
            silent.append((table, column))
    assert silent == []


@pytest.mark.parametrize("table", ["campaign", "event", "validity"])
def test_an_id_that_is_another_in_a_table_or_an_index_alone_is_told(archive, table):
    """A letter of an id, at each place of the file that has it: an index then leads to no row, or to another."""
    with closing(sqlite3.connect(archive.path)) as database:
        (name,) = database.execute(f"SELECT id FROM {table}").fetchone()
    data, silent = archive.path.read_bytes(), []
    places = [found.start() for found in re.finditer(name.encode(), data)]
    for place in places:
        archive.path.write_bytes(
            data[:place] + (b"g" if data[place] != b"g"[0] else b"h") + data[place + 1 :]
        )
        try:
            told = faults(sp.open_archive(archive.path))
        except InputError as error:
            told = [str(error)]
        if not told:
            silent.append(place)
    assert len(places) >= 3
    assert silent == []


@pytest.mark.parametrize("table", NAMES)
def test_a_row_that_is_gone_is_named(archive, table):
    with tampered(archive.path) as database:
        (rowid, name, *_) = database.execute(f"SELECT rowid, * FROM {table}").fetchone()
        database.execute(f"DELETE FROM {table} WHERE rowid = {rowid}")
    name = table if table in ("satellite", "instrument") else name[:12]
    assert any(name in fault for fault in faults(archive))


@pytest.mark.parametrize(
    ("added", "said"),
    [
        ("INSERT INTO satellite VALUES('SAT2')", "the table satellite: 'SAT2' is of no campaign"),
        ("INSERT INTO instrument VALUES('SAT1', 'other', 'star_tracker')", "'other' is of no campaign"),
        ("INSERT INTO input SELECT id, 'b.csv', '' FROM campaign", "its rows in input were changed"),
        (
            "INSERT INTO event VALUES('x', 'SAT1', 0, 'reboot', '', '')",
            "event x (reboot) is not what its id says",
        ),
        ("INSERT INTO event VALUES('x', 'SAT1', 0, 'reboot', '', '')", "event x (reboot) has no digest"),
    ],
)
def test_a_row_that_was_put_in_is_named(archive, added, said):
    with closing(sqlite3.connect(archive.path)) as database, database:
        database.execute(added)
    assert any(said in fault for fault in faults(archive))


def test_the_terminal_has_every_fault_and_one_sentence(archive):
    with tampered(archive.path) as database:
        database.execute("UPDATE campaign SET name = 'day\x1b[2J'")
    done = starplumb("archive", "verify", archive.path)
    assert done.status == 3
    assert len([line for line in done.out.splitlines() if "its rows in campaign were changed" in line]) == 3
    assert "and 5 more, wanted rows as they were added" in done.err
    assert done.err.count("\n") == 1
    assert "\x1b" not in done.out + done.err


def test_a_result_and_its_rows_that_differ_are_told_though_their_digests_agree(archive):
    """Someone who writes the digests anew, too."""
    with tampered(archive.path) as database:
        (id_,) = database.execute("SELECT id FROM campaign WHERE name = 'day 0'").fetchone()
        (image,) = database.execute("SELECT max(image_id) FROM image WHERE campaign = ?", (id_,)).fetchone()
        database.execute(
            "UPDATE image SET observations = 7 WHERE image_id = ? AND campaign = ?", (image, id_)
        )
        database.execute("UPDATE campaign SET status = 'weak' WHERE id = ?", (id_,))
        database.execute("UPDATE campaign SET matrix = zeroblob(72) WHERE id = ?", (id_,))
        database.execute("DELETE FROM meta WHERE key = ?", (seals.seal_of("campaign", id_),))
        seals.seal(database, "campaign", id_)
    of = f"campaign {id_[:12]} (day 0): its result says another "
    assert faults(archive) == [f"{of}status, another mounting", f"{of}observations of image {image}"]


def test_a_kept_file_that_was_changed_is_named(made, tmp_path):
    shutil.copytree(made.path.parent, tmp_path / "copy")
    archive = sp.open_archive(tmp_path / "copy" / "mission.db")
    campaign = archive.listed[0]["id"]
    digest = json.loads((tmp_path / "copy" / "c0" / "result.json").read_text())["inputs"]["images.csv"]
    blobs.place_of(archive.path, digest).write_bytes(gzip.compress(b"other"))
    found = archive.verify()
    assert found["not_kept"] == {campaign: ["images.csv"]}
    assert found["faults"] == [
        f"campaign {campaign[:12]} (day 0): what is kept of images.csv is not what its digest says"
    ]


INSERT = "INSERT INTO event VALUES('x', 'SAT1', 0, '', '', '');"
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            "DROP TABLE event; CREATE VIEW event AS "
            f"{ENDLESS} SELECT 'a' AS id, 'SAT1' AS satellite, i AS t_ns, '' AS kind, '' AS note FROM n",
            'found another view "event", which no archive has',
        ),
        (
            f"CREATE TRIGGER t AFTER INSERT ON event BEGIN {INSERT} END",
            'found a trigger "t", which no archive has',
        ),
        ("CREATE TABLE more(x)", 'found a table "more", which no archive has'),
        ("CREATE INDEX i ON event(kind)", 'found an index "i", which no archive has'),
        ("DROP INDEX image_by_time", "found no index image_by_time"),
        ("DROP TRIGGER image_DELETE", "found no trigger image_DELETE"),
    ],
)
@pytest.mark.parametrize("verb", ["list", "verify"])
def test_other_tables_than_those_of_an_archive_are_refused(archive, change, said, verb):
    with closing(sqlite3.connect(archive.path)) as database:
        database.executescript(change)
    done = starplumb("archive", verb, archive.path)
    assert (done.status, done.out) == (2, "")
    assert f"{archive.path}: {said}" in done.err
    assert done.err.count("\n") == 1


def test_statistics_of_the_database_itself_do_no_harm(archive):
    with closing(sqlite3.connect(archive.path)) as database, database:
        database.execute("ANALYZE")
    assert len(archive.listed) == 3


def test_a_question_without_end_is_ended(archive, monkeypatch):
    for name, value in {"STEPS": 100, "STEPS_A_BYTE": 0, "BETWEEN": 10}.items():
        monkeypatch.setattr(form, name, value)
    with pytest.raises(InputError, match="found a search in it that does not end"):
        archive.trend()


def test_a_result_that_unpacks_without_end_is_not_unpacked(archive, monkeypatch):
    monkeypatch.setattr("starplumb.io.archive.rows.MOST_TEXT", 1000)
    with pytest.raises(InputError, match="a result that breaks off, or does not end"):
        archive.trend()


def test_nothing_is_taken_to_another_place_than_its_own(archive, tmp_path):
    """A digest that is a path: what is kept under it would be written wherever that leads."""
    with tampered(archive.path) as database:
        database.execute("UPDATE input SET sha256 = 'sha256:aa/../../../leaked' WHERE name = 'images.csv'")
        database.execute("DELETE FROM meta WHERE key GLOB 'seal campaign*'")
    kept = blobs.folder_of(archive.path) / "aa"
    (kept / "aa").mkdir(parents=True)
    (tmp_path / "leaked.gz").write_bytes(gzip.compress(b"{}"))
    target = tmp_path / "other" / "deeper" / "other.db"
    with pytest.raises(InputError, match=r"found a damaged archive .*a digest that is none"):
        sp.open_archive(target, create=True).merge(archive.path)
    assert not list((tmp_path / "other").rglob("leaked*"))


def test_rows_that_were_changed_are_not_taken_by_another_archive(archive, tmp_path):
    with tampered(archive.path) as database:
        database.execute("UPDATE normal SET count = count + 1")
    target = sp.open_archive(tmp_path / "other.db", create=True)
    with pytest.raises(InputError, match=r"mission\.db: found rows of campaign \w+ changed .*\(in normal\)"):
        target.merge(archive.path)
    assert target.listed == []


def test_what_is_taken_from_another_archive_is_as_it_was_there(archive, tmp_path):
    target = sp.open_archive(tmp_path / "other.db", create=True, satellite="SAT1")
    assert target.merge(archive.path)["campaigns"] == 3
    assert target.merge(archive.path)["campaigns"] == 0
    assert faults(target) == []
    assert target.trend().document["points"] == archive.trend().document["points"]


def test_a_result_whose_inputs_have_no_digests_is_not_added(made, tmp_path):
    document = json.loads((made.path.parent / "c0" / "result.json").read_text())
    document["inputs"]["images.csv"] = "sha256:../../../leaked"
    (tmp_path / "result.json").write_text(json.dumps({k: v for k, v in document.items() if k != "files"}))
    with pytest.raises(
        InputError, match=r'inputs: found "sha256:\.\./\.\./\.\./leaked" of "images.csv", wanted'
    ):
        sp.open_archive(tmp_path / "new.db", create=True).add(tmp_path / "result.json")


class Seen(HTMLParser):
    """What a page has that a browser would run or load."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attributes):
        self.found += [(tag, name) for name, _ in attributes if name.startswith("on") or name == "src"]


def test_words_of_an_archive_are_words_on_its_page(made, tmp_path):
    evil = "'\"><img src=q onerror=alert(1)><!--</script>"
    archive = sp.open_archive(tmp_path / "mission.db", create=True, satellite=evil)
    for name in ("c0", "c1"):
        text = (
            (made.path.parent / name / "result.json")
            .read_text()
            .replace('"day ', f'"{json.dumps(evil)[1:-1]} ')
        )
        (tmp_path / name).mkdir()
        (tmp_path / name / "result.json").write_text(text)
        shutil.copy(made.path.parent / name / "normals.json", tmp_path / name)
        archive.add(tmp_path / name)
    archive.event("2020-01-21T00:00:00", evil, evil)
    archive.issue(evil)
    assert starplumb("archive", "trend", archive.path, "--out", tmp_path / "page").status == 0
    page, seen = (tmp_path / "page" / "trend.html").read_text(), Seen()
    seen.feed(page)
    assert seen.found == []
    assert page.count(html.escape(evil)) >= 3


def test_an_archive_behind_a_link_keeps_its_files_beside_itself(made, tmp_path):
    (tmp_path / "real").mkdir()
    real = sp.open_archive(tmp_path / "real" / "mission.db", create=True, satellite="SAT1")
    (tmp_path / "link.db").symlink_to(real.path)
    sp.open_archive(tmp_path / "link.db").add(made.path.parent / "c0")
    assert real.verify()["not_kept"] == {}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link.db", "real"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("[]", "JSON that is no object"),
        ('{"method": 3}', "options that are none"),
        ('{"drift": []}', "options that are none"),
        ('{"estimate": 3}', "options that are none"),
        ('{"estimate": [3]}', "options that are none"),
        ('{"estimate": [["a", "px"]]}', "options that are none"),
        ('{"estimate": [["a", 3, 1.0]]}', "options that are none"),
        ('{"estimate": [["a", "px", "1"]]}', "numbers that are not finite"),
        ('{"estimate": [["a", "px", Infinity]]}', "numbers that are not finite"),
    ],
)
def test_options_that_are_none_are_told(options, said):
    with pytest.raises(ValueError, match=said):
        cells.options(options)


@pytest.mark.parametrize(
    "P",
    [
        np.diag([1.0, -1e-3, 1.0]),
        np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        np.array([[0.0, 1e-3, 0.0], [1e-3, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    ],
)
def test_a_covariance_that_is_none_is_told(archive, P):
    """In a campaign's row, and in what was issued."""
    with pytest.raises(ValueError, match="a covariance that is none"):
        cells.covariance(P.tobytes())
    whole = np.zeros((12, 12))
    whole[3:6, 3:6] = P
    with tampered(archive.path) as database:
        (text,) = database.execute("SELECT model_json FROM validity").fetchone()
        text = json.dumps(json.loads(text) | {"covariance_arcsec2": whole.tolist()})
        database.execute("UPDATE validity SET model_json = ?", (text,))
    with pytest.raises(InputError, match="an issued mounting that is none: a negative variance"):
        sp.predict(archive.path, "2026-06-01T00:00:00")


@pytest.mark.parametrize(
    "P", [np.zeros((3, 3)), np.outer([1e-6, 2.0, 3e3], [1e-6, 2.0, 3e3]), np.diag([0.0, 1.0, 1e-20])]
)
def test_a_singular_covariance_is_one(P):
    np.testing.assert_array_equal(cells.covariance(P.tobytes()), P)


def test_the_options_of_an_archive_are_read(archive):
    with tampered(archive.path) as database:
        database.execute('UPDATE campaign SET options_json = \'{"method": [], "estimate": []}\'')
    done = starplumb("archive", "rerun", archive.path)
    assert (done.status, done.out) == (2, "")
    assert 'found a damaged archive ("options that are none")' in done.err


@pytest.mark.parametrize("name", ["a\0b", "n" * 5000, "images.csv/x", "../" * 30 + "leaked", "/leaked"])
def test_kept_files_are_written_where_their_campaign_is_or_not_at_all(made, tmp_path, name):
    shutil.copytree(made.path.parent, tmp_path / "copy")
    archive = sp.open_archive(tmp_path / "copy" / "mission.db")
    id_ = next(one["id"] for one in archive.listed if one["name"] == "day 0")
    with tampered(archive.path) as database:
        change = "UPDATE input SET name = ? WHERE name = 'observations.csv' AND campaign = ?"
        database.execute(change, (name, id_))
    (done,) = archive.rerun(id_)["not_run"]
    assert re.search(
        "cannot be written where its campaign wants it|lies elsewhere, not beside", done["reason"]
    )


@contextmanager
def as_nobody():
    """The rights of an account that has none."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)


@pytest.fixture
def open_folder():
    """A folder to which every account comes."""
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        yield Path(name)
        Path(name).chmod(0o755)


@pytest.mark.parametrize(("file", "folder"), [(0o444, 0o555), (0o444, 0o777), (0o644, 0o555)])
def test_an_archive_is_read_where_it_cannot_be_written(archive, open_folder, file, folder):
    path = open_folder / "mission #1?.db"
    shutil.copy(archive.path, path)
    path.chmod(file)
    open_folder.chmod(folder)
    wanted = archive.show().document["sigma_arcsec"], archive.trend().document["points"]
    with as_nobody():
        found = sp.open_archive(path)
        assert len(found.listed) == 3
        assert (found.show().document["sigma_arcsec"], found.trend().document["points"]) == wanted
        assert sp.predict(path, "2026-06-01T00:00:00").document["matrix"]
        assert found.verify()["faults"] == []
        with pytest.raises(InputError, match="found no way to write it or the files beside it"):
            found.event("2020-01-21T00:00:00", "reboot")
        assert [one.name for one in open_folder.iterdir()] == [path.name]


def test_an_archive_that_changes_while_it_is_read_alone_is_told(archive, open_folder):
    path = open_folder / "mission.db"
    shutil.copy(archive.path, path)
    open_folder.chmod(0o555)
    with (
        as_nobody(),
        pytest.raises(InputError, match="found it written by another program while it was read"),
    ):
        changed_meanwhile(path)


def changed_meanwhile(path):
    account = os.geteuid()
    with store.opened(path):
        os.seteuid(os.getuid())
        os.utime(path, (0, 0))
        os.seteuid(account)


@pytest.mark.parametrize("verb", ["list", "show", "trend"])
def test_times_whose_leap_seconds_are_not_known_yet_are_told(archive, verb):
    """Of an archive that a machine with a newer table wrote."""
    with tampered(archive.path) as database:
        database.execute("UPDATE campaign SET last_ns = last_ns + 60 * 31556952000000000")
    done = starplumb("archive", verb, archive.path)
    assert done.status == 2
    assert f"{archive.path}: found 2060-" in done.err
    assert "wanted an epoch within the leap-second table, which covers 1972-01-01 to 20" in done.err


def test_a_folder_that_may_not_be_entered_is_told(archive, open_folder):
    (open_folder / "closed").mkdir(mode=0o700)
    with as_nobody(), pytest.raises(InputError, match="found a file that may not be read, wanted an archive"):
        sp.open_archive(open_folder / "closed" / "mission.db")
