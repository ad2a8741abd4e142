"""Which matches of a chip are believed, and what is tried again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from blobs import Blobs, grid

from starplumb.imagery import chips
from starplumb.imagery.acquisition import Peak
from starplumb.imagery.chips import STEP_PX, looked_for, matched
from starplumb.imagery.matching.orientation import RIM_PX
from starplumb.imagery.prediction import Piece
from starplumb.imagery.verdicts import Verdict

N = 48
FAINT = Peak(np.zeros(2), 2.0, 1.0)


def piece_of(ground):
    return Piece(ground.on(151, STEP_PX), STEP_PX, np.zeros(3))


def clouded(rng, ground, place, size=N + 2 * RIM_PX):
    """A window of a ground whose right third lies under bright, soft cloud, with noise."""
    x, _ = grid(size)
    window = ground.on(size, 1.0, place)
    cover = 0.5 + 0.5 * np.tanh((x - 8.0) / 2.0)
    return (1.0 - cover) * window + cover * 6.0 * np.std(window) + rng.normal(0.0, 0.02, (size, size))


@pytest.mark.parametrize("none_agree", [False, True])
def test_a_chip_partly_under_cloud_is_matched_in_the_rest_by_what_agrees_or_else_by_what_is_dark(
    rng, monkeypatch, none_agree
):
    ground, place = Blobs.draw(rng), (0.3, -0.2)
    piece, window = piece_of(ground), clouded(rng, ground, place)
    if none_agree:
        monkeypatch.setattr(chips, "AGREES", 2.0)
    found, refused = matched(piece, window, looked_for(piece, window)[0])
    assert refused is None
    error = found.place_px - 0.5 * (N - 1.0) - place - found.point_px
    assert np.all(np.abs(error) < 4.5 * np.sqrt(np.diag(found.covariance_px2)))
    assert np.abs(error).max() < 0.1
    # it is told in what is seen
    assert found.place_px[0] < 0.5 * (N - 1.0)


def test_where_the_correlation_of_all_does_not_stand_out_a_match_lies_where_that_of_its_pixels_does(rng):
    ground, place = Blobs.draw(rng), (0.3, -0.2)
    piece, window = piece_of(ground), clouded(rng, ground, place)
    found, refused = matched(piece, window, FAINT)
    assert refused is None
    moved = replace(found, place_px=found.place_px + np.array([0.0, 0.9]))
    assert chips.unlikely(moved, FAINT) is None
    verdict, reason = chips._elsewhere(moved, piece, window, FAINT)
    assert verdict == Verdict.NO_MATCH
    assert "px from where the part that is seen is most alike" in reason


def test_a_match_that_explains_little_needs_a_correlation_that_stands_out(rng):
    ground = Blobs.draw(rng)
    piece, window = piece_of(ground), clouded(rng, ground, (0.3, -0.2))
    found, _ = matched(piece, window, FAINT)
    little = replace(found, agreement=0.45, kept=0.9)
    verdict, reason = chips.unlikely(little, FAINT)
    assert (verdict, reason) == (Verdict.NO_MATCH, "like the reference to 0.45 only")
    assert chips.unlikely(little, replace(looked_for(piece, window)[0], height=9.0)) is None
    assert chips.unlikely(replace(little, agreement=-0.55), FAINT) is None


def test_a_window_of_another_place_is_refused_in_every_way(rng):
    piece = piece_of(Blobs.draw(rng))
    refused = []
    for _ in range(2):
        window = clouded(rng, Blobs.draw(rng), (0.0, 0.0))
        _, why = matched(piece, window, looked_for(piece, window)[0])
        refused.append(why)
    assert all(refused)


def test_pixels_far_brighter_than_the_darker_half_are_cloud_and_those_without_data_are_not(rng):
    window = rng.normal(100.0, 5.0, (N, N))
    window[:, 30:] = 200.0
    window[0, 0] = np.nan
    below = chips._below_cloud(window)
    assert below[:, :28].mean() > 0.9
    assert not below[:, 32:].any()
    assert not chips._below_cloud(np.full((N, N), np.nan)).any()
