"""Every trial of a study as a Parquet table, written chunk by chunk so that memory stays flat."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...disk.publish import Content
from ...physics.errors import ArgumentError
from ...physics.units import ARCSEC
from ...study.monte_carlo import Arrays, Samples
from ...study.store import Store

SAMPLES = "samples.parquet"
Format = Literal["parquet", "none"]


def choose(wanted: str) -> Format:
    """The format of the samples; ``auto`` is Parquet.  Raises InputError for another one."""
    if wanted == "netcdf":
        raise ArgumentError(
            "samples",
            "found 'netcdf', which is no longer written, wanted parquet, which holds the same columns",
        )
    if wanted not in ("auto", "parquet", "none"):
        raise ArgumentError("samples", f"found {wanted!r}, wanted auto, parquet or none")
    return "none" if wanted == "none" else "parquet"


def sample_files(store: Store, format: Format) -> dict[str, Content]:
    """The table of samples of a finished study, to be written beside its summary."""
    return {} if format == "none" else {SAMPLES: lambda path: _write_parquet(path, store)}


def columns(arrays: Arrays, method: str, first: int) -> dict[str, NDArray[Any]]:
    """Columns of one chunk and method, ``first`` the number of its first trial."""
    prefix = f"{method}/samples/"
    part = Samples(**{f.name: arrays[prefix + f.name] for f in fields(Samples)})
    table: dict[str, NDArray[Any]] = {"trial": first + np.arange(part.status.size)}
    for k, axis in enumerate("xyz"):
        table[f"error_{axis}_arcsec"] = part.theta_E[:, k] / ARCSEC
        table[f"sigma_{axis}_arcsec"] = part.sigma_E[:, k] / ARCSEC
    return table | {
        "nees": part.nees,
        "chi2_per_degree_of_freedom": part.fit,
        "status": part.status.astype(np.int8),
    }


def _tables(store: Store) -> Iterator[tuple[str, dict[str, NDArray[Any]]]]:
    """Method and columns, chunk by chunk."""
    first = 0
    for arrays in store.load():
        for method in store.study.methods:
            yield method, columns(arrays, method, first)
        first += int(arrays["trials"])


def _write_parquet(path: Path, store: Store) -> None:
    """One row for each trial and method; a row group for each chunk and method."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    writer = None
    try:
        for method, table in _tables(store):
            names = pa.array([method] * len(table["trial"])).dictionary_encode()
            rows = pa.table({"method": names, **table})
            if writer is None:
                writer = pq.ParquetWriter(path, rows.schema, compression="zstd")
            writer.write_table(rows)
    finally:
        if writer is not None:
            writer.close()
