"""A measurement that ends early goes on from its finished images, to the same bits."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from lights import write_lights
from on_disk import write_world
from world import world

from command import starplumb
from starplumb.imagery.chain import Wanted, measure_images
from starplumb.imagery.search import Found
from starplumb.imagery.targets import chain as targets_chain
from starplumb.imagery.targets.measuring import targets_of
from starplumb.io.imagery.kept import KeptImages, packed, unpacked
from starplumb.session.imagery.measuring import measure_watched

PIXEL = 9e-6 / 2.2
SMALL = Wanted(grid=(2, 2))
PRIOR = np.diag((PIXEL * np.array([12.0, 12.0, 30.0])) ** 2)
OWN = np.diag((PIXEL * np.array([2.0, 2.0, 4.0])) ** 2)


def same(one, other):
    a, b = packed(one), packed(other)
    assert a.keys() == b.keys()
    for name, values in a.items():
        np.testing.assert_array_equal(values, b[name])


class Gone:
    """A raw image that must not be read again."""

    size_px = (150, 150)

    def window(self, column, row, columns, rows):
        raise AssertionError("read again")


@pytest.mark.slow
def test_finished_images_are_not_measured_again_and_the_answer_is_the_same_to_the_bit(tmp_path, rng):
    scene, _ = world(rng, images=2, size=150, attitude_px=1.0)
    heard = []
    whole = list(measure_images(scene, PRIOR, OWN, SMALL, heard.append))
    assert heard == [1, 2, 3, 4, 4, 5, 6, 7, 8, 8]
    kept = KeptImages.beside(tmp_path / "measured", "these inputs")
    first = next(measure_images(scene, PRIOR, OWN, SMALL, memory=kept))
    same(first, whole[0])
    resumed = replace(scene, raws=(Gone(), scene.raws[1]))
    again = list(measure_images(resumed, PRIOR, OWN, SMALL, memory=kept))
    for one, other in zip(again, whole, strict=True):
        same(one, other)
    assert KeptImages.beside(tmp_path / "measured", "others").recall("image00000") is None
    spoilt = tmp_path / "measured.unfinished" / "image00000.npz"
    spoilt.write_bytes(spoilt.read_bytes()[:-200])
    assert kept.recall("image00000") is None
    same(kept.recall("image00001"), whole[1])
    note = tmp_path / "measured.unfinished" / "mine.txt"
    note.write_text("a user's")
    kept.remove()
    assert [path.name for path in note.parent.iterdir()] == ["mine.txt"]


def test_targets_of_finished_images_are_not_looked_for_again(tmp_path, rng, monkeypatch):
    write_lights(tmp_path, rng, 60, 3.0, images=2, size=70)
    settings, out = tmp_path / "campaign.toml", tmp_path / "out"
    whole = measure_watched(settings, lambda done, total: None)
    looked = []

    def counted(*arguments):
        looked.append(arguments)
        return targets_of(*arguments)

    def interrupted(done, total):
        assert (done, total) == (1, 2)
        raise KeyboardInterrupt

    monkeypatch.setattr(targets_chain, "targets_of", counted)
    with pytest.raises(KeyboardInterrupt):
        measure_watched(settings, interrupted, out)
    again = measure_watched(settings, lambda done, total: None, out)
    assert len(looked) == 2
    assert again.document == whole.document
    again.save(out, report=False)
    assert not (tmp_path / "out.unfinished").exists()


def test_what_is_kept_comes_back_as_it_was(rng):
    from starplumb.imagery.chips import Chip
    from starplumb.imagery.pictures import Picture
    from starplumb.imagery.verdicts import Candidate, Verdict

    picture = Picture("a", "a-000", *(rng.normal(size=(2, 3, 3)).astype(np.float32)), peak=(0.1, 1.0 / 3.0))
    place = rng.normal(size=2)
    chip = Chip(Candidate(3, 0, place, place, Verdict.NO_MATCH, "why", gain=np.nan, check=np.True_), picture)
    again = unpacked(packed(chip))
    assert again.candidate.verdict is Verdict.NO_MATCH
    assert again.candidate.check is True
    assert again.picture.peak == (0.1, 1.0 / 3.0)
    assert again.picture.window.dtype == np.float32
    np.testing.assert_array_equal(again.picture.window, picture.window)
    assert np.isnan(again.candidate.gain)
    assert again.candidate.p_J is None


@pytest.mark.slow
def test_a_killed_command_goes_on_and_ends_as_one_that_was_not(tmp_path, rng):
    write_world(tmp_path, rng, size=150)
    settings = tmp_path / "campaign.toml"
    settings.write_text(settings.read_text().replace("grid = [4, 4]", "grid = [2, 2]"))
    out, kept = tmp_path / "out", tmp_path / "out.unfinished"
    arguments = ["measure", str(settings), "--no-report", "--out"]
    program = [sys.executable, "-c", "from starplumb.cli import main; main()"]
    child = subprocess.Popen([*program, *arguments, str(out)], stderr=subprocess.PIPE, text=True)
    while child.poll() is None and not (kept / "acquired.npz").exists():
        time.sleep(0.005)
    child.send_signal(signal.SIGKILL)
    child.communicate()
    assert child.returncode == -signal.SIGKILL
    assert (kept / "acquired.npz").exists()
    assert not out.exists()
    for place in (out, tmp_path / "other"):
        assert starplumb(*arguments, place).status == 0
    assert not kept.exists()
    for name in ("landmarks.csv", "observations.csv", "campaign.toml", "measure.json"):
        assert (out / name).read_bytes() == (tmp_path / "other" / name).read_bytes()


def test_what_is_kept_is_said_where_the_work_ends_early(tmp_path, monkeypatch):
    from starplumb.cli import measure as command
    from starplumb.physics.errors import InputError

    said = []
    monkeypatch.setattr(command, "complain", said.append)
    KeptImages.beside(tmp_path / "out", "these").keep("image00000", Found(np.eye(3), 1, 2))
    with pytest.raises(InputError), command._kept(tmp_path / "out", quiet=False):
        raise InputError("ortho.tif: found pixels that cannot be read")
    assert said == [
        f"1 image finished and kept in {tmp_path / 'out.unfinished'}; the same command goes on from there"
    ]
    with pytest.raises(InputError), command._kept(tmp_path / "none", quiet=False):
        raise InputError("ortho.tif: found pixels that cannot be read")
    assert len(said) == 1
