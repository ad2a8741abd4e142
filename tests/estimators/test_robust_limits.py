"""Where robust believes an agreement, and where it calls a whole image wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from problems import C_EK_TRUE, FRAME, truth
from starplumb.estimators.protocol import Status, Verdict
from starplumb.estimators.robust import Robust
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure


def measured(rng, **options):
    o = observe(truth(FRAME, **options))
    return measure(o, C_EK_TRUE, Errors.draw(o, rng))


@pytest.mark.parametrize("markers", [3, 5, 8])
def test_labels_wholly_at_random_are_no_answer(markers, rng):
    """Some sightings agree by chance; that is not enough."""
    for _ in range(5):
        table = measured(rng, images=4, markers=markers)
        xy = rng.permutation(table.xy_K)
        found = Robust()(replace(table, xy_K=xy), C_EK_TRUE)
        assert found.status == Status.NOT_CONVERGED


@pytest.mark.parametrize(("bad", "verdict"), [(3, Verdict.SIGHTING), (4, Verdict.IMAGE), (6, Verdict.IMAGE)])
def test_an_image_is_called_wrong_from_four_sightings_that_agree(bad, verdict, rng):
    """All sightings of the third image shifted by 400 px: with three of them, each is only itself wrong."""
    table = measured(rng, images=6, markers=8)
    table = table.select((table.image != 2) | (np.arange(table.n) % 8 < bad))
    xy = table.xy_K + (table.image == 2)[:, None] * 400.0 * 9e-6 / 2.2
    found = Robust()(replace(table, xy_K=xy), C_EK_TRUE)
    assert found.status == Status.OK
    assert set(found.verdict[table.image == 2]) == {int(verdict)}
    assert np.all(found.verdict[table.image != 2] == Verdict.USED)
