"""Every trial of a study as a table: Parquet or netCDF, written chunk by chunk so that memory stays flat."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from ...physics.units import ARCSEC
from ...study.monte_carlo import Arrays, Samples
from ...study.store import Store

Format = Literal["parquet", "netcdf", "none"]

_NEEDS: dict[str, tuple[str, ...]] = {"parquet": ("pyarrow",), "netcdf": ("h5netcdf", "h5py")}
_NAMES = {"parquet": "samples.parquet", "netcdf": "samples.nc"}


def choose(wanted: str) -> Format:
    """The format that can be written here: ``auto`` takes Parquet, then netCDF, then none.

    Raises InputError where a wanted format's library is not installed.
    """
    here = {name: all(find_spec(module) for module in modules) for name, modules in _NEEDS.items()}
    if wanted == "auto":
        return "parquet" if here["parquet"] else "netcdf" if here["netcdf"] else "none"
    if wanted == "parquet" or wanted == "netcdf":
        if not here[wanted]:
            listed = " and ".join(_NEEDS[wanted])
            raise InputError(f"--samples {wanted} needs {listed}; wanted pip install 'starplumb[samples]'")
        return "parquet" if wanted == "parquet" else "netcdf"
    if wanted != "none":
        raise InputError(f"--samples: found {wanted!r}, wanted auto, parquet, netcdf or none")
    return "none"


def write_samples(store: Store, folder: Path, format: Format) -> Path | None:
    """Write the samples of a finished study beside its summary; the file appears when it is whole."""
    if format == "none":
        return None
    path = folder / _NAMES[format]
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        (_write_parquet if format == "parquet" else _write_netcdf)(beside, store)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
    return path


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


def _write_netcdf(path: Path, store: Store) -> None:
    """A group for each method, a variable for each column along ``trial``."""
    import h5netcdf

    with h5netcdf.File(path, "w") as file:
        file.attrs["title"] = f"starplumb simulation of {store.study.scenario.name}"
        for method in store.study.methods:
            file.create_group(method).dimensions["trial"] = store.study.trials
        for method, table in _tables(store):
            group, first = file[method], int(table["trial"][0])
            for name, values in table.items():
                if name not in group.variables:
                    group.create_variable(
                        name, ("trial",), values.dtype, chunks=(min(store.study.trials, 65536),)
                    )
                group[name][first : first + values.size] = values
