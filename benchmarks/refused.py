"""How much memory and time a table takes that is sound row by row and does not fit its campaign.

Each table has its fault in the last row, or shows it by the number of its rows; each command runs in a process of its
own.

Run:  python benchmarks/refused.py [--megabytes 1000] [--only WORD]
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from itertools import count, islice
from pathlib import Path

from starplumb.physics.timescales import format_iso

START_NS = 634_000_000 * 10**9
Lines = Iterator[str]


def observations(images: int = 5_000, landmarks: int = 6_000) -> Lines:
    """Pairs that are each there once."""
    tails = [f",L{j:05d},{100 + j % 800}.25,{90 + j % 700}.5,0.3\n" for j in range(landmarks)]
    for i in range(images):
        yield f"im{i:05d}".join(["", *tails])


def numbered(row: str) -> Lines:
    """A row with another number each time, a thousand at once."""
    for start in count(0, 1_000):
        yield "".join([row.format(k) for k in range(start, start + 1_000)])


def timed(row: str) -> Lines:
    """Rows a millisecond apart."""
    for start in count(0, 1_000):
        times = format_iso([START_NS + 10**6 * k for k in range(start, start + 1_000)], "UTC", 3)
        yield "".join([f"{time}{row}" for time in times])


ATTITUDE, EPHEMERIS = ",0.0,0.0,0.0,1.0\n", ",7000123.456,123.456,-456.789\n"
SEEN = "image_id,landmark_id,column_px,row_px,sigma_px\n"
KINDS: dict[str, tuple[str, str, Callable[[], Lines], str]] = {
    "landmark that there is not": ("observations.csv", SEEN, observations, "im00001,LOST,1.5,2.5,0.3\n"),
    "pair twice": ("observations.csv", SEEN, observations, "im00001,L00001,1.5,2.5,0.3\n"),
    "pixel outside": ("observations.csv", SEEN, observations, "im00001,L00001,1.5,2e7,0.3\n"),
    "images without end": (
        *("images.csv", "image_id,time\n"),
        *(lambda: numbered("i{:08d},2020-02-02T11:00:00.000\n"), ""),
    ),
    "landmarks without end": (
        *("landmarks.csv", "landmark_id,latitude_deg,longitude_deg,height_m,sigma_m\n"),
        *(lambda: numbered("m{:08d},12.345678,23.456789,123.4,0.5\n"), ""),
    ),
    "attitude goes back": (
        *("attitude.csv", "time,qx,qy,qz,qw\n"),
        *(lambda: timed(ATTITUDE), "2020-02-02T00:00:00,0.0,0.0,0.0,1.0\n"),
    ),
    "attitude is none": (
        *("attitude.csv", "time,qx,qy,qz,qw\n"),
        *(lambda: timed(ATTITUDE), "2021-02-02T00:00:00,0.0,0.0,0.0,1.1\n"),
    ),
    "orbit in the Earth": (
        *("ephemeris.csv", "time,x_m,y_m,z_m\n"),
        *(lambda: timed(EPHEMERIS), "2021-02-02T00:00:00,7.0,0.0,0.0\n"),
    ),
}
"""By what is wrong: the table, its head, its rows, and the last one."""


def written(path: Path, head: str, lines: Lines, last: str, size: int) -> None:
    """A table of some bytes."""
    with path.open("w", encoding="ascii", newline="") as file:
        done = file.write(head)
        for text in lines:
            done += file.write(text)
            if done >= size:
                break
        file.write(last)


def campaign(folder: Path, many: bool) -> None:
    """The demo, with images and landmarks enough for the rows above where there are ``many``."""
    subprocess.run([sys.executable, "-m", "starplumb", "init", str(folder)], check=True, capture_output=True)
    if many:
        first = (folder / "images.csv").read_text().splitlines()[1].split(",")[1]
        times = "".join(islice(numbered("im{:05d},TIME\n"), 5)).replace("TIME", first)
        (folder / "images.csv").write_text(KINDS["images without end"][1] + times)
        places = islice(numbered("L{:05d},0.0,0.0,0.0,0.5\n"), 6)
        (folder / "landmarks.csv").write_text(KINDS["landmarks without end"][1] + "".join(places))


def measured(kind: str, size: int) -> dict[str, object]:
    name, head, lines, last = KINDS[kind]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "demo"
        campaign(folder, many=name == "observations.csv")
        written(folder / name, head, lines(), last, size)
        done = subprocess.run(
            [sys.executable, "-m", "starplumb", "check", str(folder / "campaign.toml")],
            capture_output=True,
            text=True,
            check=False,
        )
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        shutil.rmtree(folder)
    said = done.stderr.strip().rpartition("/")[2]
    return {
        "kind": kind,
        "bytes": size,
        "cpu_s": round(used.ru_utime + used.ru_stime, 1),
        "memory_gb": round(used.ru_maxrss * 1024 / 1e9, 2),
        "status": done.returncode,
        "said": said[:160],
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--megabytes", type=int, default=1000)
    parser.add_argument("--only", default="")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.one:
        print(json.dumps(measured(asked.one, 10**6 * asked.megabytes)))
        return
    print(
        f"tables of {asked.megabytes} MB\n\n| what is wrong | CPU s | GB | status | said |\n|---|---|---|---|---|"
    )
    for kind in KINDS:
        if asked.only in kind:
            child = [sys.executable, __file__, "--megabytes", str(asked.megabytes), "--one", kind]
            found = json.loads(subprocess.run(child, check=True, capture_output=True, text=True).stdout)
            print("| {kind} | {cpu_s} | {memory_gb} | {status} | {said} |".format(**found), flush=True)


if __name__ == "__main__":
    main()
