"""Plans of images: speed and distance from the bound, small cases against all choices, sampling, and the gain.

python benchmarks/plan.py speed        10 000 candidates, 100 images, in CPU seconds
python benchmarks/plan.py small        the best of all choices of small cases
python benchmarks/plan.py sampled      the planned accuracy against 8000 simulated campaigns
python benchmarks/plan.py missions     the gain against views abeam of the home site, three shipped missions
python benchmarks/plan.py nadir        the gain against views of the home site from almost straight above
"""

from __future__ import annotations

import itertools
import sys
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import starplumb as sp
from starplumb.estimators.gls import Gls
from starplumb.io.scenario.candidates import agility, candidate_information, home_site, stage
from starplumb.io.scenario.read import find_scenario, read_scenario
from starplumb.io.text.toml import read_toml
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan.choice.certificate import Room, certificate
from starplumb.plan.choice.ground import ground_weight
from starplumb.plan.choice.pick import Design, State, greedy
from starplumb.plan.choice.views import Sites, limits, slots, views
from starplumb.session.planning.choice import Asked, choose, covariance, picked
from starplumb.study.monte_carlo import Study

P0 = np.eye(3) * DEG**2
SITES = """\
site,latitude_deg,longitude_deg,height_m
Tuz Golu,38.70,33.35,905
Railroad Valley,38.50,-115.70,1435
Dunhuang,40.13,94.33,1220
Gobabeb,-23.60,15.12,510
Ceduna,-32.10,133.70,10
"""
UNKNOWNS: dict[str, dict[str, Any]] = {
    "clock offset": {"error": "time-tag", "sigma_ms": 5.0},
    "site survey": {"error": "landmark", "sigma_m": 1.0, "shared_by": "campaign"},
    "orbital drift": {"error": "drift", "sigma_arcsec": 2.0},
}
"""What mission planners often leave out: a clock of the campaign, an offset of each site's survey, a drift."""


def main() -> None:
    kinds = {"speed": speed, "small": small, "sampled": sampled, "missions": missions, "nadir": nadir}
    for name in sys.argv[1:] or kinds:
        kinds[name]()


def _drawn(count: int, rng: np.random.Generator) -> Sites:
    names = tuple(f"s{k}" for k in range(count))
    latitude, longitude = rng.uniform(-60, 60, count) * DEG, rng.uniform(-180, 180, count) * DEG
    return Sites(names, latitude, longitude, np.zeros(count), np.ones(count))


def speed() -> None:
    """The shipped 6U mission with 40 sites over 100 days."""
    read = read_scenario("cubesat-6u")
    flown, able = stage(read.config, read.folder), agility(read.config, scans=False)
    home = home_site(read.config)
    assert home is not None
    sites = home.and_(_drawn(39, np.random.default_rng(1)))
    print("| step | CPU s | |\n|---|---|---|")
    clock = time.process_time()

    def lap(step: str, said: str) -> None:
        nonlocal clock
        print(f"| {step} | {time.process_time() - clock:.2f} | {said} |")
        clock = time.process_time()

    found = views(flown.orbit, flown.orientation, flown.epoch_ns, (0.0, 100 * 86400.0), sites, able)
    clash = limits(found, able, flown.exposed_s)
    lap("views", f"{found.n} views in {np.unique(found.pass_of).size} passes")
    told = candidate_information(flown, found, sites, P0)
    lap("what each tells", f"rank {told.factor.shape[-1]} of {told.factor.shape[1]} unknowns")
    design = Design(told, P0, ground_weight(flown.camera, flown.C_EK, 500e3))
    state = State(design)
    picks = greedy(state, clash, 100)
    first = state.value
    lap("100 images, one after another", f"{np.sqrt(first):.3f} m")
    picks = picked(design, clash, 100)
    value = design.value(covariance(design, picks))
    lap("the same with one round of exchanges", f"{np.sqrt(value):.3f} m")
    start = np.zeros(found.n)
    start[picks] = 1.0
    room = Room(100, slots(found, able, flown.exposed_s), found.pass_of, able.per_pass)
    proof = certificate(design, room, start)
    bound = np.sqrt(proof.bound)
    within = [100.0 * (np.sqrt(x) / bound - 1.0) for x in (first, value)]
    lap("bound", f"{bound:.3f} m: within {within[0]:.2f} %, exchanged {within[1]:.2f} %")


def small(cases: int = 30) -> None:
    """5 of 14 real views of two sites, every choice tried."""
    read = read_scenario("cubesat-6u")
    flown, able = stage(read.config, read.folder), agility(read.config, scans=False)
    home = home_site(read.config)
    assert home is not None
    sites, rng = home.and_(_drawn(3, np.random.default_rng(2))), np.random.default_rng(7)
    found = views(flown.orbit, flown.orientation, flown.epoch_ns, (0.0, 30 * 86400.0), sites, able)
    told = candidate_information(flown, found, sites, P0)
    W = ground_weight(flown.camera, flown.C_EK, 500e3)
    clash = limits(found, able, flown.exposed_s)
    none = replace(clash, first=clash.first[:0], second=clash.second[:0])
    ratios = []
    for _ in range(cases):
        mine = np.sort(rng.choice(told.n, 14, replace=False))
        part = told.only(mine)
        names = [np.unique(of, return_inverse=True)[1] for of in (part.pass_of, part.site_of)]
        part = replace(part, pass_of=names[0], site_of=names[1])
        design, free = Design(part, P0, W), replace(none, pass_of=names[0])
        best = min(_dense(design, some) for some in itertools.combinations(range(14), 5))
        state = State(design)
        greedy(state, free, 5)
        chosen = _dense(design, tuple(picked(design, free, 5)))
        ratios.append((np.sqrt(state.value / best), np.sqrt(chosen / best)))
    mean, worst = np.mean(ratios, axis=0), np.max(ratios, axis=0)
    print(f"\n{cases} cases, error on the ground over that of the best of all 2002 choices:\n")
    print("| | mean | worst |\n|---|---|---|")
    for k, name in enumerate(("one after another", "with exchanges")):
        print(f"| {name} | {mean[k]:.4f} | {worst[k]:.4f} |")


def _dense(design: Design, picks: tuple[int, ...]) -> float:
    """The criterion by one matrix over all unknowns."""
    i = design.information
    passes, sites = int(i.pass_of.max()) + 1, int(i.site_of.max()) + 1
    N = np.eye(i.common + passes * i.of_pass + sites * i.of_site)
    N[:3, :3] = np.linalg.inv(design.P_theta)
    for j in picks:
        a = i.common + i.of_pass * int(i.pass_of[j])
        b = i.common + i.of_pass * passes + i.of_site * int(i.site_of[j])
        at = [*range(i.common), *range(a, a + i.of_pass), *range(b, b + i.of_site)]
        N[np.ix_(at, at)] += i.factor[j] @ i.factor[j].T
    return design.value(np.linalg.inv(N))


def sampled(trials: int = 8000) -> None:
    """Ten planned images of the 6U mission, every error drawn as the scenario has it, estimated by gls."""
    read = read_scenario("cubesat-6u")
    flown = stage(read.config, read.folder)
    home = home_site(read.config)
    assert home is not None
    sites = home.and_(_drawn(3, np.random.default_rng(2)))
    found = choose(flown, sites, Asked(10, 0.0, 0.0, 30 * 86400.0, None))
    scenario = found.scenario
    theta = Study(scenario, {"gls": Gls()}, 5, trials, chunk=trials).samples(0)["gls"].theta_E
    rms = np.sqrt(np.mean(theta**2, axis=0)) / ARCSEC
    planned, checked = (np.sqrt(np.diagonal(P)) / ARCSEC for P in (found.clear_E, found.checked_E))
    ground = np.sqrt(np.mean(np.einsum("ni,ij,nj->n", theta, found.design.W, theta)))
    spread = 100 / np.sqrt(2 * trials)
    print(
        f"\n{trials} simulated campaigns of {len(found.picks)} planned images; sampling error {spread:.1f} %:\n"
    )
    print("| | x | y | z | on the ground |\n|---|---|---|---|---|")
    for name, s, m in (
        ("planned", planned, found.rms(found.clear_E)),
        ("by the whole noise model", checked, found.rms(found.checked_E)),
        ("rms of the simulated errors", rms, ground),
    ):
        print(f"| {name} | " + " | ".join(f'{x:.2f}"' for x in s) + f" | {m:.2f} m |")


def missions(days: float = 60.0) -> None:
    """As many images as the home site can be seen abeam, once so and once as planned."""
    head = (
        "mission",
        "errors",
        "images",
        "home site abeam",
        "planned, home",
        "planned, six sites",
        "bound",
        "gain",
    )
    print("\n| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for name in ("cubesat-6u", "vhr-0.3m", "wide-swath"):
        for more in (False, True):
            print("| " + " | ".join(_mission(name, days, more)) + " |", flush=True)


def _mission(name: str, days: float, more: bool) -> tuple[str, ...]:
    document = read_toml(find_scenario(name))
    document.setdefault("site", {"latitude_deg": 43.56, "longitude_deg": 4.86})
    if more:
        document["truth"] |= UNKNOWNS
    scenario = sp.scenario(document)
    with TemporaryDirectory() as folder:
        table = Path(folder) / "sites.csv"
        table.write_text(SITES, encoding="utf-8")
        abeam = sp.plan_images(scenario, 40, days=days).document["usual"]
        n = abeam["images"]
        home = sp.plan_images(scenario, n, days=days).document
        found = sp.plan_images(scenario, n, sites=table, days=days).document
    rms = [abeam["rms_m"], home["images"][-1]["rms_m"], found["images"][-1]["rms_m"], found["bound"]["rms_m"]]
    errors = "with clock, survey, drift" if more else "as shipped"
    return name, errors, str(n), *(f"{x:.3g} m" for x in rms), f"{rms[0] / rms[2]:.2f}"


def nadir(days: float = 60.0, look_deg: float = 5.0) -> None:
    """As many images as the home site can be seen from within so much of the vertical, once so and once as planned."""
    head = (
        "mission",
        "errors",
        "images",
        "home from above",
        "home abeam",
        "planned, home",
        "planned, six sites",
        "gain",
    )
    print("\n| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for name in ("cubesat-6u", "vhr-0.3m", "wide-swath"):
        for errors, more in (
            ("as shipped", {}),
            ("with a clock", {"clock offset": UNKNOWNS["clock offset"]}),
            ("with clock, survey, drift", UNKNOWNS),
        ):
            print(
                "| " + " | ".join((name, errors, *_from_above(name, more, days, look_deg))) + " |", flush=True
            )


def _from_above(name: str, more: dict[str, Any], days: float, look_deg: float) -> tuple[str, ...]:
    document = read_toml(find_scenario(name))
    document.setdefault("site", {"latitude_deg": 43.56, "longitude_deg": 4.86})
    document["truth"] |= more
    steep = document | {"plan": document.get("plan", {}) | {"max_look_deg": look_deg}}
    above = sp.plan_images(sp.scenario(steep), 40, days=days).document["usual"]
    scenario, n = sp.scenario(document), above["images"]
    with TemporaryDirectory() as folder:
        table = Path(folder) / "sites.csv"
        table.write_text(SITES, encoding="utf-8")
        home = sp.plan_images(scenario, n, days=days).document
        found = sp.plan_images(scenario, n, sites=table, days=days).document
    last = [plan["images"][-1]["rms_m"] for plan in (home, found)]
    rms = [above["rms_m"], home["usual"]["rms_m"], *last]
    return str(n), *(f"{x:.3g} m" for x in rms), f"{rms[0] / rms[3]:.2f}"


if __name__ == "__main__":
    main()
