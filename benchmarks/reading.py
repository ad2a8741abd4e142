"""Reading: what it costs to load a campaign from its files, beside what is then done with it.

    python benchmarks/reading.py 100000 1000000

A simulated campaign of so many sightings, each of a landmark of its own, 100 to an image, is written to a temporary
folder with all its digits (written so, numbers cost the most).  CPU seconds of this process, best of several rounds
(set OPENBLAS_NUM_THREADS=1), and the largest memory that loading takes above what it returns, by tracemalloc in a run
of its own.  The rows of the observations are also read cell by cell by the standard library, as all files were once
and unusual ones are still.  Markdown on stdout.
"""

from __future__ import annotations

import argparse
import tempfile
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from calibrate import best, write

from starplumb.estimators.gls import Gls
from starplumb.estimators.selfcal import SelfCalibration
from starplumb.io.campaign.read import load_campaign
from starplumb.io.tables import parsers as table_parsers
from starplumb.io.tables.header import Wanted
from starplumb.io.tables.plain import read_plain
from starplumb.io.tables.rows import read_rows
from starplumb.table.geometry import observe
from starplumb.table.parameters import OPTICS, Optics

MARKERS = 100
OBSERVATIONS = Wanted(("image_id", "landmark_id"), ("column_px", "row_px", "sigma_px"))
LANDMARKS = Wanted(
    ("landmark_id",),
    ("latitude_deg", "longitude_deg", "height_m", "sigma_east_m", "sigma_north_m", "sigma_up_m"),
)


def parsers(path: Path, wanted: Wanted, rounds: int) -> list[tuple[str, float]]:
    """CPU seconds to read the rows of a table with each parser."""
    found = []
    for name, make in (("PyArrow", table_parsers.arrow_parser), ("NumPy", table_parsers.numpy_parser)):
        found.append((name, best(partial(_read, path, wanted, make), rounds)[0]))
    found.append(("standard library, cell by cell", best(lambda: read_rows(path, wanted), 1)[0]))
    return found


def _read(path: Path, wanted: Wanted, make: Callable[..., Any]) -> Any:
    """The rows of a table by one parser, whatever the size of the file."""
    return read_plain(path, wanted, lambda _, header, wanted: make(header, wanted))


def above(path: Path) -> tuple[float, float]:
    """Memory of a loaded campaign and the most that loading takes above it, MB."""
    tracemalloc.start()
    loaded = load_campaign(path)
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    del loaded
    return kept / 2.0**20, (peak - kept) / 2.0**20


def report(path: Path, rounds: int) -> None:
    """The table of one campaign."""
    size = sum(file.stat().st_size for file in path.parent.iterdir()) / 2.0**20
    loading, loaded = best(lambda: load_campaign(path), rounds)
    campaign = loaded.campaign
    print(
        f"\n{campaign.sightings.image.size} sightings, {len(campaign.images.ids)} images, {size:.0f} MB of files\n"
    )
    print("| step | CPU s |\n|---|---|")
    for file, wanted in (("observations.csv", OBSERVATIONS), ("landmarks.csv", LANDMARKS)):
        for name, seconds in parsers(path.parent / file, wanted, rounds):
            print(f"| rows of {file}, {name} | {seconds:.2f} |", flush=True)
    print(f"| the whole campaign, read and checked | {loading:.2f} |", flush=True)
    table, o = best(lambda: observe(campaign), rounds)
    print(f"| table of observations (orbit, attitude, light effects) | {table:.2f} |", flush=True)
    optics = SelfCalibration((Optics(campaign.camera, OPTICS, (float("inf"),) * len(OPTICS)),))
    for name, estimator in (("gls", Gls()), ("gls with 8 numbers of interior orientation", optics)):
        seconds, _ = best(lambda estimator=estimator: estimator(o, campaign.C_EK), rounds)
        print(f"| {name} | {seconds:.2f} |", flush=True)
    kept, more = above(path)
    print(f"\nThe campaign takes {kept:.0f} MB; loading takes {more:.0f} MB above that at the most.")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sizes", type=int, nargs="*", default=[100_000, 1_000_000])
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    for n in options.sizes:
        with tempfile.TemporaryDirectory() as folder:
            report(write(Path(folder) / "campaign", n // MARKERS, MARKERS), options.rounds)


if __name__ == "__main__":
    main()
