"""What is said of chips of which it is known what they show: planted against told.

    python benchmarks/verdicts.py [TRIALS] [SEED]

Set OPENBLAS_NUM_THREADS=1.  The chips of `matching.py` at SNR 20, spoilt each in one way, in an image of which a fifth
is cloud; the verdicts are those of `measure`, without the comparison of an image's chips with one another.
"""

from __future__ import annotations

import sys
from collections import Counter
from types import SimpleNamespace

import numpy as np
from matching import CHIP, Hard, chip

from starplumb.imagery.chips import _chip
from starplumb.imagery.drawn.sky import BRIGHT, Sky
from starplumb.imagery.matching.orientation import RIM_PX
from starplumb.imagery.verdicts import Brightness, Candidate, Verdict

NOISE = 1.0 / 20.0
FULL = 6.0
SIZE = CHIP + 2 * RIM_PX


def clouds(rng, drawn, cover):
    at = np.arange(float(SIZE))
    sky = Sky(cover, int(rng.integers(1 << 20)), 40.0, (9.0, 6.0))
    return sky.over((SIZE, SIZE)).veil(drawn.window, at, at)


def flat(level):
    return lambda rng, drawn: level + NOISE * rng.normal(size=(SIZE, SIZE))


def elsewhere(rng, drawn):
    return chip(rng, Hard()).window


def half_elsewhere(rng, drawn):
    return np.where(np.arange(SIZE) < SIZE // 2, drawn.window, elsewhere(rng, drawn))


def beside(rng, drawn):
    """The same ground seen 12 px on: nothing matches within what is searched, though all looks alike."""
    return np.roll(drawn.window, (12, 12), axis=(0, 1))


def without(rng, drawn):
    return np.where(np.arange(SIZE) < 0.45 * SIZE, np.nan, drawn.window)


def full(rng, drawn):
    return np.where(np.arange(SIZE) < 0.3 * SIZE, FULL, drawn.window)


PLANTED = {
    "good": lambda rng, drawn: drawn.window,
    "half under cloud": lambda rng, drawn: clouds(rng, drawn, 0.5),
    "nine tenths under cloud": lambda rng, drawn: clouds(rng, drawn, 0.9),
    "all cloud, smooth": flat(BRIGHT),
    "water": flat(-1.8),
    "no texture": flat(0.0),
    "half changed": half_elsewhere,
    "all changed": elsewhere,
    "12 px beside": beside,
    "45 % beyond the border": without,
    "30 % saturated": full,
}


def brightness(rng):
    """That of an image a fifth of which is cloud."""
    ground = np.concatenate([chip(rng, Hard()).window.ravel() for _ in range(8)])
    return Brightness.of(np.where(rng.random(ground.size) < 0.2, BRIGHT, ground))


def verdict(rng, spoil, bright):
    drawn = chip(rng, Hard())
    scene = SimpleNamespace(saturation_dn=FULL)
    nowhere = Candidate(0, 0, np.zeros(2), np.zeros(2), Verdict.NO_MATCH)
    return _chip(scene, nowhere, drawn.piece, spoil(rng, drawn), bright, 0.001, ("i", "c")).candidate.verdict


if __name__ == "__main__":
    trials, seed = (int(a) for a in (*sys.argv[1:3], *("40", "4")[len(sys.argv[1:3]) :]))
    words = ["used", "cloud", "water", "no texture", "changed", "no match", "edge", "saturated"]
    print("| planted | " + " | ".join(words) + " |")
    print("|---|" + "---|" * len(words))
    bright = brightness(np.random.default_rng(seed))
    for k, (name, spoil) in enumerate(PLANTED.items()):
        rng = np.random.default_rng([seed, k])
        told = Counter(str(verdict(rng, spoil, bright)) for _ in range(trials))
        print(f"| {name} | " + " | ".join(str(told[word] or "") for word in words) + " |", flush=True)
