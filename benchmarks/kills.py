"""Is what a killed command leaves the old or the new, whole?  Kills without warning at random moments.

python benchmarks/kills.py --kills 200

Half of the kills fall anywhere in the run, a quarter after the first file has been begun, a quarter as soon as the
order of the renames is noted.  A set counts as old or new where every file of it is, to the byte; ``between`` counts
those that are neither, ``told`` those among them whose mark says so by its digests.  After the kills of each row the
command runs once more and must give the new set and no remains.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

COMMAND = [sys.executable, "-c", "from starplumb.cli import main; main()"]
State = dict[str, str]


def starplumb(folder: Path, *arguments: str) -> None:
    done = subprocess.run([*COMMAND, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, (arguments, done.stderr)


def state(folder: Path) -> State:
    """The digest of every file of a set; chunks of a study are no part of it."""
    paths = [path for path in folder.rglob("*") if path.is_file() and "chunks" not in path.parts]
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in paths
        if ".starplumb-" not in str(path) and ".unfinished" not in str(path)
    }


def campaigns(folder: Path) -> State:
    """Of an archive what it says that it holds, and that it finds itself whole."""
    import starplumb as sp

    archive = sp.open_archive(folder / "m.db")
    assert archive.verify()["faults"] == []
    return {str(i): str(entry["name"]) for i, entry in enumerate(archive.listed)}


def told(folder: Path) -> bool:
    """Whether a mark in the folder names a digest that a file beside it has not."""
    for mark in folder.rglob("*.json"):
        if ".starplumb-" in str(mark) or "chunks" in mark.parts:
            continue
        files = json.loads(mark.read_text(encoding="utf-8")).get("files") or {}
        for name, digest in files.items():
            path = mark.parent / name
            if not path.is_file() or "sha256:" + hashlib.sha256(path.read_bytes()).hexdigest() != digest:
                return True
    return False


@dataclass(frozen=True)
class Case:
    """A command, and how its folder is before: ``old`` is run there first, nothing where it is empty."""

    name: str
    old: tuple[str, ...]
    new: tuple[str, ...]
    see: Callable[[Path], State] = state


GRID = ("locate", "campaign.toml", "--image", "image01", "-q", "--grid")
STUDY = (
    "simulate",
    "two-images",
    "--chunk",
    "200",
    "--workers",
    "1",
    "--methods",
    "gls",
    "--out",
    "study",
    "-q",
)
TABLE = ("reproduce", "table3", "--out", "tables", "-q")
SIGMAS = ("--sigma-m", "1", "--sigma-arcsec", "5", "-q")
CASES = (
    Case("calibrate, first", (), ("calibrate", "campaign.toml", "--gpkg", "-q")),
    Case(
        "calibrate, again",
        ("calibrate", "campaign.toml", "--gpkg", "-q", "-m", "gls"),
        ("calibrate", "campaign.toml", "--gpkg", "-q"),
    ),
    Case("simulate", (*STUDY, "--trials", "400"), (*STUDY, "--trials", "800")),
    Case("locate --grid .npy", (*GRID, "g.npy", "--every", "100"), (*GRID, "g.npy", "--every", "20")),
    Case("locate --grid .tif", (*GRID, "g.tif", "--every", "100"), (*GRID, "g.tif", "--every", "20")),
    Case("import, new", (), ("import", "a.tsai", "new", *SIGMAS)),
    Case("import --into", ("import", "a.tsai", "new", *SIGMAS), ("import", "b.tsai", "--into", "new", "-q")),
    Case("measure, first", (), ("measure", "world/campaign.toml", "--out", "m", "-q")),
    Case(
        "measure, again",
        ("measure", "world/campaign.toml", "--out", "m", "-q"),
        ("measure", "world/other.toml", "--out", "m", "-q"),
    ),
    Case("reproduce", (*TABLE, "--trials", "200"), (*TABLE, "--trials", "300")),
    Case(
        "archive add",
        ("archive", "add", "m.db", "one/result.json", "-q"),
        ("archive", "add", "m.db", "two/result.json", "-q"),
        campaigns,
    ),
)


def prepare_world(folder: Path) -> None:
    """A campaign of one raw image with its reference, and the same with fewer chips."""
    tests = Path(__file__).resolve().parents[1] / "tests"
    sys.path[:0] = [str(tests / "imagery"), str(tests)]
    import numpy as np
    from on_disk import write_world

    folder.mkdir()
    write_world(folder, np.random.default_rng(11))
    text = (folder / "campaign.toml").read_text()
    (folder / "other.toml").write_text(text.replace("grid = [4, 4]", "grid = [3, 4]"))


def prepare(folder: Path, archive: bool, world: bool) -> None:
    """A campaign, two products of one camera, and, if wanted, an archive with two results to come, or images."""
    import numpy as np
    import rasterio

    warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
    folder.mkdir()
    starplumb(folder, "init", "demo", "-q")
    for path in (folder / "demo").iterdir():
        path.rename(folder / path.name)
    (folder / "demo").rmdir()
    profile = {"driver": "GTiff", "width": 30, "height": 20, "count": 1, "dtype": "uint8"}
    for name, x in (("a", 6_878_137.0), ("b", 6_878_138.0)):
        with rasterio.open(folder / f"{name}.tif", "w", **profile) as file:
            file.write(np.zeros((1, 20, 30), dtype=np.uint8))
        camera = [
            "fu = 28",
            "fv = 28",
            "cu = 0.09",
            "cv = 0.06",
            "u_direction = 1 0 0",
            "v_direction = 0 1 0",
        ]
        pose = ["w_direction = 0 0 1", f"C = {x} 0 0", "R = 0 0 -1 0 1 0 1 0 0", "pitch = 0.0064"]
        (folder / f"{name}.tsai").write_text("\n".join(["VERSION_4", "PINHOLE", *camera, *pose, "NULL", ""]))
    if world:
        prepare_world(folder / "world")
    if not archive:
        return
    starplumb(folder, "archive", "init", "m.db", "-q")
    for name, seed in (("one", "1"), ("two", "2")):
        starplumb(folder, "init", f"{name}-campaign", "--seed", seed, "-q")
        for table in ("landmarks.csv", "observations.csv"):  # other markers need other names
            path = folder / f"{name}-campaign" / table
            path.write_text(path.read_text().replace("gcp", f"{name}-"))
        starplumb(folder, "calibrate", f"{name}-campaign/campaign.toml", "--no-report", "-q", "--out", name)


def begun(work: Path) -> bool:
    """Whether a command has begun to write a file."""
    return seen(work, ".starplumb-*", "*/.starplumb-*", "m.db-*")


def placing(work: Path) -> bool:
    """Whether it is about to rename what it has written, or has an archive's log to close."""
    return seen(work, ".starplumb-*/.order", "*/.starplumb-*/.order", "m.db-*")


def seen(work: Path, *patterns: str) -> bool:
    try:
        return any(any(work.glob(pattern)) for pattern in patterns)
    except FileNotFoundError:  # gone while it was looked into
        return False


def kill_once(case: Case, old: Path, work: Path, seconds: float, draw: random.Random, i: int) -> None:
    """Run the command in a copy of the old folder and kill it: anywhere, at its writing, or at its renaming."""
    shutil.rmtree(work, ignore_errors=True)
    shutil.copytree(old, work)
    process = subprocess.Popen(
        [*COMMAND, *case.new], cwd=work, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    if i % 2:
        time.sleep(draw.uniform(0.0, seconds))
    else:
        far, within = (begun, 0.05) if i % 4 else (placing, 0.002)
        while process.poll() is None and not far(work):
            time.sleep(0.0002)
        time.sleep(draw.uniform(0.0, within))
    process.kill()
    process.wait()


def row(case: Case, base: Path, kills: int, draw: random.Random) -> Counter[str]:
    old, new, work = base / "old", base / "new", base / "work"
    for folder in (old, new):
        shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(base / "prepared", old)
    if case.old:
        starplumb(old, *case.old)
    shutil.copytree(old, new)
    begin = time.perf_counter()
    starplumb(new, *case.new)
    seconds = time.perf_counter() - begin
    before, after, found = case.see(old), case.see(new), Counter[str]()
    assert before != after
    for i in range(kills):
        kill_once(case, old, work, seconds, draw, i)
        found["remains"] += any(work.rglob(".starplumb-*"))
        seen = case.see(work)
        kind = "old" if seen == before else "new" if seen == after else "between"
        found[kind] += 1
        found["told"] += kind == "between" and told(work)
    starplumb(work, *case.new)
    found["again"] = int(case.see(work) == after and not any(work.rglob(".starplumb-*")))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=200, help="of all commands together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    cases = [case for case in CASES if case.name.startswith(given.only)]
    with tempfile.TemporaryDirectory() as name:
        base = Path(name)
        wanted = [case.new[0] for case in cases]
        prepare(base / "prepared", "archive" in wanted, "measure" in wanted)
        print(
            "| command | kills | old | new | between | of these told | remains | run again |\n"
            + "|---" * 8
            + "|"
        )
        for i, case in enumerate(cases):
            kills = given.kills * (i + 1) // len(cases) - given.kills * i // len(cases)
            found = row(case, base, kills, random.Random(given.seed + i))
            cells = [found[key] for key in ("old", "new", "between", "told", "remains")]
            again = "the new, nothing else" if found["again"] else "WRONG"
            print("|", " | ".join(map(str, (case.name, kills, *cells, again))), "|", flush=True)


if __name__ == "__main__":
    main()
