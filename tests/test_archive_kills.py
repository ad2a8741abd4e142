"""Two programs that write into one archive, killed without warning: what was committed is there, whole."""

from __future__ import annotations

import multiprocessing
import time

import numpy as np
import pytest

import starplumb as sp
from starplumb.io.archive import store, verification
from starplumb.io.archive.conflicts import known
from starplumb.io.archive.insertion import insert
from starplumb.io.archive.records import digest
from starplumb.io.archive.rows import ImageRow, Instrument, NewCampaign


def campaign(number):
    """A campaign of three images of one landmark each."""
    inputs, options = [f"sha256:{number:064x}"], {"method": "gls", "estimate": [], "drift": "none"}
    names = ["mounting", f"landmark[L{number}]"]
    images = [
        ImageRow(f"i{i}", 10**12 * number + i, None, None, {}, None, 1, f"{number} {i}") for i in range(3)
    ]
    return NewCampaign(
        digest(inputs, options),
        digest(inputs),
        Instrument("S", "camera", "tracker"),
        f"c{number}",
        number,
        number,
        "{}",
        "gls",
        options,
        "ok",
        np.eye(3),
        None,
        "{}" * 5000,
        {"campaign.toml": inputs[0]},
        images,
        [(name, "m", np.zeros(3), np.zeros(3), np.eye(3)) for name in names],
        [(f"i{i}", names, np.arange(21.0), np.zeros(6), 1.0, 2) for i in range(3)],
    )


def write(path, notes, first, count):
    """Add campaigns, noting each once it is committed."""
    with notes.open("a") as file:
        for number in range(first, first + count):
            new = campaign(number)
            with store.opened(path) as database, store.transaction(database):
                if not known(database, new):
                    insert(database, new, "now")
            file.write(f"{number}\n")
            file.flush()


def whole(path):
    """The campaigns of an archive, each with all its rows."""
    with store.opened(path) as database:
        half = database.execute(
            "SELECT count(*) FROM campaign c WHERE (SELECT count(*) FROM image i WHERE i.campaign = c.id) <> 3 "
            "OR (SELECT count(*) FROM normal n WHERE n.campaign = c.id) <> 3"
        ).fetchone()[0]
        assert list(verification.faults(database)) == []
    assert half == 0
    return {int(entry.name[1:]) for entry in sp.open_archive(path).entries}


@pytest.mark.slow
def test_nothing_that_was_committed_is_lost_when_writers_are_killed(tmp_path, rng):
    path, notes = tmp_path / "mission.db", [tmp_path / "a", tmp_path / "b"]
    store.create(path, "S")
    forked = multiprocessing.get_context("fork")
    killed = 0
    for round_ in range(6):
        writers = [
            forked.Process(target=write, args=(path, note, 8 * round_ + 4 * k, 12))
            for k, note in enumerate(notes)
        ]
        for writer in writers:
            writer.start()
        for writer in writers:
            time.sleep(rng.uniform(0.0, 0.15))
            killed += writer.is_alive()
            writer.kill()
        for writer in writers:
            writer.join()
    noted = {int(line) for note in notes if note.exists() for line in note.read_text().split()}
    assert killed > 0
    assert noted <= whole(path)
    write(path, notes[0], 0, 12)  # the archive goes on as if nothing had been
    assert set(range(12)) <= whole(path)


def test_a_campaign_is_there_as_a_whole_or_not_at_all(tmp_path):
    path = tmp_path / "mission.db"
    store.create(path, "S")

    def interrupted():
        with store.opened(path) as database, store.transaction(database):
            insert(database, campaign(1), "now")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert whole(path) == set()
