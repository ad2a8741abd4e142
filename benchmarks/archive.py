"""The archive of a mission: is its joint solution that of one big campaign, is anything lost, how long does it take?

    python benchmarks/archive.py joint --runs 40     # 20 campaigns of one site, beside the mean of their results
    python benchmarks/archive.py kills --kills 1000  # concurrent writers killed at random moments
    python benchmarks/archive.py trend               # 10 years of 50 campaigns
    python benchmarks/archive.py fleet --satellites 500  # a campaign of each satellite, and the same again

``joint``: each campaign has three images of the same nine markers and a session of its own; every error is drawn as it
is stated, the survey's once for all.  ``kills``: two writers add the same and different campaigns until one is killed.
"""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scenes import C_EK_TRUE, CAMERA, ORBIT, SIGMAS, UniformEarth

import starplumb as sp
from starplumb.documents.normals import NormalsDocument, joined, normals_document
from starplumb.estimators.gls import Gls
from starplumb.io.archive import store, verification
from starplumb.io.archive.conflicts import known
from starplumb.io.archive.insertion import insert
from starplumb.io.archive.records import digest as key
from starplumb.io.archive.rows import ImageRow, Instrument, NewCampaign
from starplumb.io.campaign.write import write_campaign
from starplumb.judge.calibrate import Calibration, calibrate
from starplumb.physics import so3
from starplumb.physics.earth import geodetic_to_itrf, itrf_to_geodetic
from starplumb.physics.light import Corrections
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import scene
from starplumb.session.mission.adding import coming
from starplumb.table.campaign import Campaign, SharedErrors
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors

CAMPAIGNS, IMAGES, DAY_NS = 20, 3, 86_400 * 10**9
SESSION = np.array([1.0, 1.0, 2.0]) * ARCSEC


def site(number: int) -> Campaign:
    """Three images of nine markers from a pass of its own, Earth-fixed, so many fortnights later."""
    t = 30.0 * np.arange(IMAGES)
    r_J, _ = scene.fly(ORBIT, UniformEarth(), 0, t)
    latitude, longitude, _ = itrf_to_geodetic(r_J[1])
    aim = np.broadcast_to(geodetic_to_itrf(latitude, longitude + 4e-4 * (number % 5 - 2), 0.0), (IMAGES, 3))
    yaw = DEG * np.array([0.0, 90.0, 30.0 * (number % 3)])
    campaign = scene.photograph(
        CAMERA, ORBIT, UniformEarth(), 0, scene.Pass(t, aim, yaw), C_EK_TRUE, SIGMAS, Corrections(), 0.0
    )
    offsets = 6e3 * np.array([[i, j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    marks = scene.site_grid(latitude, longitude, np.linspace(0.0, 800.0, 9), offsets)
    return scene.mark_site(campaign, marks, SIGMAS)


def later(campaign: Campaign, shift_ns: int, name: str) -> Campaign:
    """The same scene later, its attitude from the Earth's axes."""
    attitude, images = campaign.one_attitude, campaign.images
    C_EJ, _ = attitude.at(attitude.t_ns)
    return replace(
        campaign,
        name=name,
        attitude=replace(
            attitude,
            t_ns=attitude.t_ns + shift_ns,
            q_EF=so3.to_quaternion(C_EJ),
            frame="ITRF",
            orientation=None,
        ),
        ephemeris=replace(campaign.ephemeris, t_ns=campaign.ephemeris.t_ns + shift_ns),
        images=replace(
            images,
            ids=tuple(f"{name} {i}" for i in images.ids),
            t_ns=images.t_ns + shift_ns,
            sessions=(name,) * len(images.ids),
        ),
        orientation=None,
        attitude_errors=SharedErrors("image", session_sigma=SESSION),
    )


def whole(parts: Sequence[Campaign]) -> Campaign:
    """All of them as one campaign."""
    first = parts[0]
    series = [part.one_attitude for part in parts]
    orbits = [part.ephemeris for part in parts]
    names = ("landmark", "column_px", "row_px", "sigma_px", "check")
    sightings = {name: np.concatenate([getattr(p.sightings, name) for p in parts]) for name in names}
    image = np.concatenate([p.sightings.image + IMAGES * k for k, p in enumerate(parts)])
    return replace(
        first,
        name="all",
        attitude=replace(
            series[0],
            t_ns=np.concatenate([s.t_ns for s in series]),
            q_EF=np.concatenate([s.q_EF for s in series]),
        ),
        ephemeris=replace(
            orbits[0],
            t_ns=np.concatenate([o.t_ns for o in orbits]),
            r_J=np.concatenate([o.r_J for o in orbits]),
            v_J=np.concatenate([o.v_J for o in orbits]),
        ),
        images=replace(
            first.images,
            ids=tuple(i for p in parts for i in p.images.ids),
            t_ns=np.concatenate([p.images.t_ns for p in parts]),
            sessions=tuple(s for p in parts for s in p.images.sessions or ()),
        ),
        sightings=replace(first.sightings, image=image, **sightings),
    )


def flown(scenes: Sequence[Campaign], rng: np.random.Generator) -> list[Campaign]:
    """What is measured of them: one draw of the survey for all, one of a session for each."""
    tables = [observe(true) for true in scenes]
    places = Errors.draw(tables[0], rng).pi_J
    model = so3.exp(np.array([600.0, -400.0, 900.0]) * ARCSEC) @ C_EK_TRUE
    found = []
    for k, (true, table) in enumerate(zip(scenes, tables, strict=True)):
        errors = Errors.draw(table, rng)
        turned = errors.alpha_E + SESSION * rng.standard_normal(3)
        measured = scene.measured(true, replace(errors, pi_J=places, alpha_E=turned), model)
        found.append(later(measured, 14 * k * DAY_NS, f"campaign {k + 1}"))
    return found


def document(found: Calibration) -> NormalsDocument:
    written = normals_document(found)
    assert written is not None
    return NormalsDocument.of(written)


def joint(runs: int) -> None:
    scenes, rng = [site(k) for k in range(CAMPAIGNS)], np.random.default_rng(16)
    away, ratio, errors, naive = [], [], [], []
    for _ in range(runs):
        parts = flown(scenes, rng)
        one = calibrate(whole(parts), Gls()).estimate
        each = [calibrate(part, Gls()) for part in parts]
        sum_ = joined([document(found) for found in each])
        sigma = np.sqrt(np.diagonal(sum_.covariance_E))
        away.append(so3.log(sum_.C_EK @ one.C_EK.mT) / one.sigma_E)
        ratio.append(sigma / one.sigma_E)
        errors.append(so3.log(sum_.C_EK @ C_EK_TRUE.mT) / sigma)
        W = np.array([np.linalg.inv(found.estimate.covariance_E) for found in each])
        off = np.array([so3.log(found.estimate.C_EK @ C_EK_TRUE.mT) for found in each])
        P = np.linalg.inv(W.sum(axis=0))
        naive.append((P @ np.einsum("kij,kj->i", W, off), np.sqrt(np.diagonal(P))))
    stated, mean = np.mean([s for _, s in naive], axis=0), np.array([e for e, _ in naive])
    print("| about | x | y | z |\n|---|---|---|---|")
    row("joint from one campaign of all 60 images, sigmas, largest", np.max(np.abs(away), axis=0), "{:.1e}")
    row("sigma of the joint over that of the one campaign", np.mean(ratio, axis=0), "{:.6f}")
    row("joint: stated sigma, arcsec", sigma / ARCSEC, "{:.2f}")
    row(f"joint: rms error over sigma, {runs} runs", np.sqrt(np.mean(np.square(errors), axis=0)), "{:.2f}")
    row("mean of results: stated sigma, arcsec", stated / ARCSEC, "{:.2f}")
    row(
        f"mean of results: rms error over sigma, {runs} runs",
        np.sqrt(np.mean(mean**2, axis=0)) / stated,
        "{:.2f}",
    )


def row(name: str, values: np.ndarray, form: str) -> None:
    print(f"| {name} | " + " | ".join(form.format(v) for v in values) + " |")


def entry(number: int) -> NewCampaign:
    """A campaign as an archive keeps it, with eight images of twenty landmarks, of no files."""
    rng = np.random.default_rng(number)
    digest = f"sha256:{number:064x}"
    inputs = {"campaign.toml": digest}
    options = {"method": "gls", "estimate": [], "drift": "none"}
    A = rng.standard_normal((63, 63))
    names = ["mounting", *(f"landmark[L{number}-{i}]" for i in range(20))]
    unknowns = [(n, "m", np.zeros(3), np.zeros(3), np.eye(3)) for n in names]
    images = [
        ImageRow(f"i{i}", number * 10**12 + i, 0.1, 0.2, {}, 1.0, 20, f"{number}-{i}") for i in range(8)
    ]
    normals = [(f"i{i}", names, (A @ A.T)[np.triu_indices(63)], A[0], 1.0, 40) for i in range(8)]
    instrument = Instrument("SAT", "camera", "star_tracker")
    text = json.dumps({"filler": "x" * 15_000})
    return NewCampaign(
        key([digest], options), key([digest]), instrument, f"c{number}", number, number, "{}", "gls", options, "ok",
        np.eye(3), None, text, inputs, images, unknowns, normals,
    )  # fmt: skip


def write(path: Path, promises: Path, first: int, count: int) -> None:
    """Add campaigns, noting each once it is committed."""
    with promises.open("a") as file:
        for number in range(first, first + count):
            new = entry(number)
            with store.opened(path) as database, store.transaction(database):
                if not known(database, new):
                    insert(database, new, "now")
            file.write(f"{number}\n")
            file.flush()


def kills(wanted: int, count: int = 12) -> None:
    """Two writers at a time, each killed at a moment of its own while it adds campaigns that partly are the other's."""
    forked, pause, done, first, start, longest = get_context("fork"), random.Random(5), 0, 0, time.time(), 0.5
    with tempfile.TemporaryDirectory() as name:
        path, notes = Path(name) / "mission.db", [Path(name) / "a", Path(name) / "b"]
        store.create(path, "SAT")
        while done < wanted:
            writers = [
                forked.Process(target=write, args=(path, note, first + 4 * k, count))
                for k, note in enumerate(notes)
            ]
            for writer in writers:
                writer.start()
            for writer in writers:
                time.sleep(pause.uniform(0.0, longest))
                done += writer.is_alive()
                writer.kill()
            for writer in writers:
                writer.join()
            first += 3
            if done > 4 * len(
                noted(notes)
            ):  # a busy machine: let them write something before they are killed
                longest *= 1.2
        promised = noted(notes)
        there = {int(e.name[1:]) for e in sp.open_archive(path).entries}
        with store.opened(path) as database:
            half = database.execute(
                "SELECT count(*) FROM campaign c WHERE (SELECT count(*) FROM image i WHERE i.campaign = c.id) <> 8 "
                "OR (SELECT count(*) FROM normal n WHERE n.campaign = c.id) <> 8"
            ).fetchone()[0]
            faults = list(verification.faults(database))
        print(
            f"{done} kills of concurrent writers in {time.time() - start:.0f} s: {len(promised)} campaigns were noted"
        )
        print(
            f"as committed, {len(promised - there)} of them lost; {half} of {len(there)} half written; faults {faults}"
        )


def noted(notes: Sequence[Path]) -> set[int]:
    """Campaigns that writers said they had committed."""
    return {int(line) for note in notes if note.exists() for line in note.read_text().split()}


def trend(years: int = 10, a_year: int = 50) -> None:
    """The command on an archive of so many campaigns: one site of nine markers (the equations of one, repeated)."""
    with tempfile.TemporaryDirectory() as name:
        path = grown(Path(name), years * a_year, 365.25 / a_year)
        for verb in ("show", "trend"):
            before = children_s()
            code = "from starplumb.cli import main; main()"
            subprocess.run([sys.executable, "-c", code, "archive", verb, str(path), "--quiet"], check=True)
            print(
                f"archive {verb}: {years * a_year} campaigns, {children_s() - before:.2f} CPU s", flush=True
            )


def fleet(satellites: int) -> None:
    """A campaign of each satellite as one command on two workers: a quarter of them, half, all, then all again."""
    with tempfile.TemporaryDirectory() as name:
        rng, base = np.random.default_rng(4), site(0)
        for k in range(satellites):
            written = write_campaign(Path(name) / f"sat{k:03d}", flown([base], rng)[0])
            text = written.read_text()
            written.write_text(text.replace("[campaign]", f'[campaign]\nsatellite = "SAT{k:03d}"', 1))
        for count in (satellites // 4, satellites // 2, satellites, satellites):
            paths = [f"sat{k:03d}/campaign.toml" for k in range(count)]
            before, start = children_s(), time.perf_counter()
            code = "from starplumb.cli import main; main()"
            options = ["--jobs", "2", "--archive", f"fleet{count}.db", "--out", f"results{count}", "--quiet"]
            command = [sys.executable, "-c", code, "calibrate", *paths, *options]
            status = subprocess.run(command, cwd=name, check=False).returncode
            cpu, wall = children_s() - before, time.perf_counter() - start
            print(f"{count} campaigns: {cpu:.0f} CPU s, {wall:.0f} s, exit {status}", flush=True)


def children_s() -> float:
    import resource

    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def grown(folder: Path, count: int, gap_days: float) -> Path:
    """An archive of campaigns of one site, the equations of one, later and later, each as its own sightings."""
    part = flown([site(0)], np.random.default_rng(1))[0]
    campaign = sp.read_campaign(write_campaign(folder / "one", part))
    base = coming(sp.calibrate(campaign), "SAT", "").row
    path = folder / "mission.db"
    store.create(path, "SAT")
    with store.opened(path) as database, store.transaction(database):
        for k in range(count):
            late = round((k - count) * gap_days * DAY_NS)
            images = [replace(i, t_ns=i.t_ns + late, sightings=f"{k} {i.image_id}") for i in base.images]
            new = replace(
                base,
                id=f"{k:064x}",
                inputs_id=f"{k:064x}",
                first_ns=base.first_ns + late,
                last_ns=base.last_ns + late,
                images=images,
            )
            insert(database, new, "now")
    return path


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("joint", "kills", "trend", "fleet"))
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--satellites", type=int, default=500)
    arguments = parser.parse_args()
    match arguments.what:
        case "joint":
            joint(arguments.runs)
        case "kills":
            kills(arguments.kills)
        case "trend":
            trend()
        case "fleet":
            fleet(arguments.satellites)


if __name__ == "__main__":
    main()
