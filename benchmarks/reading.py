"""Reading: what it costs to load a campaign from its files, beside what is then done with it.

    python benchmarks/reading.py 100000 1000000

A simulated campaign of so many sightings, each of a landmark of its own, 100 to an image, is written to a temporary
folder with all its digits (written so, numbers cost the most).  CPU seconds of this process, best of several rounds
(set OPENBLAS_NUM_THREADS=1), and the largest memory that loading takes above what it returns, Python's by tracemalloc
and PyArrow's by its own count, in a run of its own.  The rows of the tables are also read row by row by the standard
library, as small and unusual files are, and from Parquet.  Markdown on stdout.
"""

from __future__ import annotations

import argparse
import tempfile
import tracemalloc
from pathlib import Path

import pyarrow
from calibrate import best, write
from pyarrow import csv, parquet

from starplumb.estimators.gls import Gls
from starplumb.io.campaign.read import load_campaign
from starplumb.io.tables.arrow import columns_of_table, read_binary
from starplumb.io.tables.csv_tables import read_csv
from starplumb.io.tables.schema import Schema
from starplumb.table.geometry import observe
from starplumb.table.parameters import OPTICS, Optics

MARKERS = 100
OBSERVATIONS = Schema(("image_id", "landmark_id"), ("column_px", "row_px", "sigma_px"))
LANDMARKS = Schema(
    ("landmark_id",),
    ("latitude_deg", "longitude_deg", "height_m", "sigma_east_m", "sigma_north_m", "sigma_up_m"),
)


def readers(path: Path, schema: Schema, rounds: int) -> list[tuple[str, float]]:
    """CPU seconds to read the rows of a table each way."""
    binary = path.with_suffix(".parquet")
    parquet.write_table(csv.read_csv(path), binary)
    return [
        ("CSV by PyArrow", best(lambda: read_csv(path, schema), rounds)[0]),
        ("CSV row by row", best(lambda: read_csv(path, schema, quick=False), 1)[0]),
        ("Parquet", best(lambda: columns_of_table("", read_binary(binary, "Parquet"), schema), rounds)[0]),
    ]


def above(path: Path) -> tuple[float, float, float]:
    """Memory of a loaded campaign, the most of Python's that loading takes above it, and the most of PyArrow's, MB."""
    usual = pyarrow.default_memory_pool()
    watched = pyarrow.proxy_memory_pool(usual)
    pyarrow.set_memory_pool(watched)
    tracemalloc.start()
    loaded = load_campaign(path)
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    pyarrow.set_memory_pool(usual)
    del loaded
    return kept / 2.0**20, (peak - kept) / 2.0**20, watched.max_memory() / 2.0**20


def report(path: Path, rounds: int) -> None:
    """The table of one campaign."""
    size = sum(file.stat().st_size for file in path.parent.iterdir()) / 2.0**20
    loading, loaded = best(lambda: load_campaign(path), rounds)
    campaign = loaded.campaign
    print(
        f"\n{campaign.sightings.image.size} sightings, {len(campaign.images.ids)} images, {size:.0f} MB of files\n"
    )
    print("| step | CPU s |\n|---|---|")
    for file, schema in (("observations.csv", OBSERVATIONS), ("landmarks.csv", LANDMARKS)):
        for name, seconds in readers(path.parent / file, schema, rounds):
            print(f"| rows of {file}, {name} | {seconds:.2f} |", flush=True)
    print(f"| the whole campaign, read and checked | {loading:.2f} |", flush=True)
    table, o = best(lambda: observe(campaign), rounds)
    print(f"| table of observations (orbit, attitude, light effects) | {table:.2f} |", flush=True)
    optics = Gls((Optics(campaign.camera, OPTICS, (float("inf"),) * len(OPTICS)),))
    for name, estimator in (("gls", Gls()), ("gls with 8 numbers of interior orientation", optics)):
        seconds, _ = best(lambda estimator=estimator: estimator(o, campaign.C_EK), rounds)
        print(f"| {name} | {seconds:.2f} |", flush=True)
    kept, more, arrow = above(path)
    at_most = f"{more:.0f} MB above that at the most, and {arrow:.0f} MB in PyArrow"
    print(f"\nThe campaign takes {kept:.0f} MB; loading takes {at_most}.")


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
