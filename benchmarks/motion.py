"""How well a mounting that moves is found and followed: rms, coverage, false alarms, and what is said to be detectable.

    python benchmarks/motion.py --campaigns 500 --seed 7000

30 images, three a date, a date every eight orbits, each at any phase (or a few within seven minutes of one date).  An
image fixes the mounting to the sigmas of its tracker.  The error is that of the mounting all around the orbit in the
middle of the span, of drift and step at the last image.  Constant: the mean of all images; chosen: the kind of model
of the largest weight; averaged: `--drift auto`.  Models, their weights and thresholds were set on seed 0.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from starplumb.judge.motion.averaging import averaged, structures
from starplumb.judge.motion.directed import FOUND_P, DirectedTest, directed_tests
from starplumb.judge.motion.found import around, variance_of
from starplumb.judge.motion.regressors import Scales, When, families
from starplumb.judge.motion.sums import ImageSums
from starplumb.table.phases import OrbitPhase

Array = np.ndarray
Rng = np.random.Generator
Motion = Callable[[When, Scales], Array]
PERIOD_S = 5830.0
ORBIT = OrbitPhase(0, 2.0 * np.pi / PERIOD_S)


@dataclass(frozen=True)
class Row:
    """``truth`` draws a motion (arcsec) of an amplitude; ``grown`` is what the errors are over what is stated."""

    name: str
    truth: Callable[[Rng, float], Motion]
    amplitude: float
    sigma: tuple[float, float, float] = (1.0, 1.0, 2.0)
    images: int = 30
    grown: float = 1.0
    one_date: bool = False
    at_end: bool = False


def rests(rng: Rng, amplitude: float) -> Motion:
    return lambda when, scales: np.zeros((when.t_ns.size, 3))


def sines(orders: tuple[float, ...]) -> Callable[[Rng, float], Motion]:
    """Harmonics 1, 2, ... of the amplitude times these about each axis, any phase."""

    def draw(rng: Rng, amplitude: float) -> Motion:
        phase = rng.uniform(0.0, 2.0 * np.pi, (len(orders), 3))
        return lambda when, scales: sum(
            amplitude * a * np.cos((k + 1) * when.u[:, None] - phase[k]) for k, a in enumerate(orders)
        )

    return draw


def eclipse(rng: Rng, amplitude: float) -> Motion:
    """A body that warms in the Sun, 0.65 of the orbit, and cools in the shade, time constant 0.12 orbit; its range is
    twice the amplitude."""
    grid, step = np.linspace(0.0, 3.0, 3000, retstep=True)
    warm = np.zeros(grid.size)
    for i in range(1, grid.size):
        warm[i] = warm[i - 1] + step / 0.12 * ((grid[i] % 1.0 < 0.65) - warm[i - 1])
    shape = (warm[2000:] - warm[2000:].mean()) / np.ptp(warm[2000:]) * 2.0 * amplitude
    sign, start = rng.choice([-1.0, 1.0], 3), rng.uniform()

    def motion(when: When, scales: Scales) -> Array:
        turn = (when.u / (2.0 * np.pi) + start) % 1.0
        return np.interp(turn, grid[2000:] - 2.0, shape)[:, None] * sign

    return motion


def drift(rng: Rng, amplitude: float) -> Motion:
    """From -amplitude to +amplitude."""
    sign = rng.choice([-1.0, 1.0], 3)
    return lambda when, scales: 2.0 * amplitude * scales.column("linear", when)[:, None] * sign


def jump(rng: Rng, amplitude: float) -> Motion:
    """By the amplitude in the middle of the images."""
    sign = rng.choice([-1.0, 1.0], 3)

    def motion(when: When, scales: Scales) -> Array:
        after = np.arange(when.t_ns.size) >= when.t_ns.size // 2
        return amplitude * after[:, None] * sign

    return motion


COARSE = (5.0, 5.0, 12.0)
ROWS = [
    Row("none", rests, 0.0),
    Row("none, errors twice as stated", rests, 0.0, grown=2.0),
    Row("harmonic 1, 1 arcsec", sines((1.0,)), 1.0),
    Row("harmonic 1, 2 arcsec", sines((1.0,)), 2.0),
    Row("harmonics 1 and 2, 2 and 1.2 arcsec", sines((1.0, 0.6)), 2.0),
    Row("eclipse, range 4 arcsec", eclipse, 2.0),
    Row("linear, -2 to 2 arcsec", drift, 2.0, at_end=True),
    Row("step, 2 arcsec", jump, 2.0, at_end=True),
    Row("none, tracker 5, 5, 12", rests, 0.0, COARSE),
    Row("harmonic 1, 2 arcsec, tracker 5, 5, 12", sines((1.0,)), 2.0, COARSE),
    Row("harmonic 1, 5 arcsec, tracker 5, 5, 12", sines((1.0,)), 5.0, COARSE),
    Row("none, 8 images of one date", rests, 0.0, images=8, one_date=True),
    Row("harmonic 1, 2 arcsec, 8 images of one date", sines((1.0,)), 2.0, images=8, one_date=True),
    Row("none, 6 images of two dates", rests, 0.0, images=6),
]


def images(row: Row, rng: Rng) -> tuple[When, Scales]:
    m = row.images
    t = np.sort((np.arange(m) // 3 * 8 + rng.uniform(0.0, 1.0, m)) * PERIOD_S)
    if row.one_date:
        t = np.sort(rng.uniform(0.0, 420.0, m)) + rng.uniform(0.0, PERIOD_S)
    when = When(np.rint(1e9 * t).astype(np.int64), 2.0 * np.pi * t / PERIOD_S)
    return when, Scales.of(when, ORBIT)


def sums_of(d: Array, sigma: Array) -> ImageSums:
    m = len(d)
    N = np.broadcast_to(np.diag(sigma**-2.0), (m, 3, 3))
    none = np.zeros((3, 3))
    return ImageSums(np.arange(m), N, -d / sigma**2, np.zeros((m, 0, 3)), np.zeros(0), none, none[0])


@dataclass(frozen=True)
class Found:
    """Mean squares (3,) and shares of 95 % intervals held of one campaign, constant, chosen, averaged; the tests."""

    squares: Array
    held: Array
    tests: tuple[DirectedTest, ...]
    cpu_s: float


def one(row: Row, rng: Rng) -> Found:
    when, scales = images(row, rng)
    motion = row.truth(rng, row.amplitude)
    sigma = np.array(row.sigma)
    d = row.grown * sigma * rng.normal(size=(row.images, 3)) + motion(when, scales)
    at = around(scales) if not row.at_end else When(when.t_ns[-1:], when.u[-1:])
    if row.one_date:  # what is asked of one date is the mounting then
        at = when
    true = motion(when, scales)[-1:] if row.at_end else motion(at, scales)
    start = time.process_time()
    sums, tried = sums_of(d, sigma), families(when, scales)
    tests, kinds = directed_tests(sums, when, scales, tried), structures(tried)
    variance = variance_of(tests) if tests else 1.0
    model = averaged(sums, when, scales, kinds, variance)
    cpu_s = time.process_time() - start
    best = max(model.weights, key=lambda kind: model.weights[kind])
    chosen = averaged(sums, when, scales, {best: kinds[best]}, variance)
    constant = np.mean(d, axis=0), np.diag(sigma**2 / row.images)
    found = [(np.broadcast_to(constant[0], true.shape), constant[1][None]), chosen.at(at), model.at(at)]
    errors = [np.abs(x - true) for x, _ in found]
    half = [1.96 * np.sqrt(np.diagonal(P, axis1=-2, axis2=-1)) for _, P in found]
    held = np.array([np.mean(e < h) for e, h in zip(errors, half, strict=True)])
    return Found(np.array([np.mean(e**2, axis=0) for e in errors]), held, tests, cpu_s)


def line(row: Row, campaigns: int, seed: int) -> tuple[str, float]:
    rng = np.random.default_rng([seed, ROWS.index(row)])
    found = [one(row, rng) for _ in range(campaigns)]
    rms = np.sqrt(np.mean([f.squares for f in found], axis=0))
    held = 100.0 * np.mean([f.held for f in found], axis=0)
    alarms = 100.0 * np.mean([bool(f.tests) and f.tests[0].p < FOUND_P for f in found])
    cells = [" / ".join(f"{x:.2f}" for x in axes) for axes in (rms[0], rms[2])]
    text = f"| {row.name} | {' | '.join(cells)} | {' / '.join(f'{x:.0f}' for x in held)} | {alarms:.1f} % |"
    return text, float(np.mean([f.cpu_s for f in found]))


DETECTED = {"orbit:1": sines((1.0,)), "orbit:2": sines((0.0, 1.0)), "linear": drift, "step": jump}


def detected(name: str, row: Row, factor: float, campaigns: int, seed: int) -> tuple[float, float]:
    """Median of the stated amplitude, and the share of motions of ``factor`` times it that its test finds."""
    rng, hits, stated = np.random.default_rng([seed, 99, row.images]), [], []
    half = 0.5 if name == "linear" else 1.0  # it is stated of the whole change
    for _ in range(campaigns):
        when, scales = images(row, rng)
        sigma, tried = np.array(row.sigma), families(when, scales)
        noise = sigma * rng.normal(size=(row.images, 3))
        by_name = {t.name: t.detectable for t in directed_tests(sums_of(noise, sigma), when, scales, tried)}
        if name not in by_name:  # by chance the phases of few images do not tell it
            continue
        motion = DETECTED[name](rng, factor * half * by_name[name])(when, scales)
        tests = directed_tests(sums_of(noise + motion, sigma), when, scales, tried)
        hits.append(any(t.p < FOUND_P for t in tests if t.name == name))
        stated.append(by_name[name])
    return float(np.median(stated)), float(np.mean(hits))


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("--campaigns", type=int, default=500)
    options.add_argument("--seed", type=int, default=7000)
    options.add_argument("--only", default="", help="part of the rows' names")
    asked = options.parse_args()
    print(
        "| truth | rms x / y / z, arcsec: constant | averaged | 95 % interval holds: constant / chosen / averaged "
        "| motion found |\n|---|---|---|---|---|"
    )
    cost = []
    for row in ROWS:
        if asked.only in row.name:
            text, cpu_s = line(row, asked.campaigns, asked.seed)
            cost.append(cpu_s)
            print(text, flush=True)
    if cost:
        print(f"\n{1e3 * max(cost):.0f} CPU ms a campaign at most\n")
    print("| images | test | detectable, arcsec | found at 0.8, 1, 1.2 times it |\n|---|---|---|---|")
    for m in (30, 10):
        for name in DETECTED:
            if asked.only in name:
                row = Row(f"{m} images", rests, 0.0, images=m)
                shares = [detected(name, row, f, asked.campaigns, asked.seed) for f in (0.8, 1.0, 1.2)]
                listed = ", ".join(f"{100 * share:.0f} %" for _, share in shares)
                print(f"| {m} | {name} | {shares[1][0]:.2f} | {listed} |", flush=True)


if __name__ == "__main__":
    main()
