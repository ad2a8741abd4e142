"""``starplumb simulate``: Monte Carlo of a scenario."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .output import Json, Output, Quiet, Verbose

if TYPE_CHECKING:
    from rich.table import Table

    from ..study.monte_carlo import Study
    from ..study.run import Scheduler
    from ..study.store import Store


def simulate(
    scenario: Annotated[
        str, typer.Argument(help="A SCENARIO.toml, or the name of a shipped scenario.", metavar="SCENARIO")
    ],
    trials: Annotated[int | None, typer.Option("--trials", "-n", min=2, help="Number of trials.")] = None,
    precision: Annotated[
        float | None,
        typer.Option(
            "--precision",
            min=1e-4,
            max=0.5,
            help="Choose the trials so that each sigma is known to this part of itself (3 standard errors) "
            "[default: 0.01, which is 45000 trials].",
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", "-s", min=0, help="Seed of the draws.")] = 1,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder of the results; also resumes there.")
    ] = None,
    methods: Annotated[
        str, typer.Option("--methods", "-m", help="Estimators, with commas between them.")
    ] = "gls,wahba",
    workers: Annotated[
        int | None,
        typer.Option("--workers", "-w", min=1, help="Worker processes [default: one per processor]."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", help="Address of a Dask scheduler that runs the chunks instead."),
    ] = None,
    chunk: Annotated[
        int, typer.Option("--chunk", min=1, help="Trials of a chunk; the draws depend on it.")
    ] = 4096,
    samples: Annotated[
        str, typer.Option("--samples", help="Every trial as a table: auto, parquet, netcdf or none.")
    ] = "auto",
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Say what accuracy a scenario gives, by trying it many times.

    Writes summary.json, the page report.html, the samples and figures into --out. Finished chunks are kept there:
    interrupted, the same command goes on where it stopped. The answer depends on scenario, seed, trials and chunk
    alone.

    Examples:

      starplumb simulate vhr-0.3m --trials 5000

      starplumb simulate scenario.toml --precision 0.02 --methods gls,wahba,observer --out study
    """
    from ..io.results.samples import choose as choose_samples
    from ..io.scenario.read import load_scenario
    from ..study.monte_carlo import Study
    from ..study.run import choose

    speak = Output(json, quiet, verbose)
    format = choose_samples(samples) if out is not None else "none"
    study = Study(
        load_scenario(scenario),
        chosen_estimators(methods),
        _checked_seed(seed),
        _number_of_trials(trials, precision),
        chunk,
        keep_samples=format != "none",
    )
    speak.detail(f"{study.trials} trials in {study.chunks} chunks of {study.chunk}")
    with _store(study, out) as store:
        _run(store, choose(workers, scheduler, study.chunks), quiet)
        document = _publish(store, out, format, speak)
    speak.document(document)
    speak.show(*_tables(document), *_sentences(document))
    if out is not None:
        speak.show(f"written: {out}")


def _number_of_trials(trials: int | None, precision: float | None) -> int:
    from ..physics.errors import InputError
    from ..study.statistics import trials_for

    if trials is not None and precision is not None:
        raise InputError("--precision: found beside --trials, wanted only one of the two")
    return trials if trials is not None else trials_for(0.01 if precision is None else precision)


def _checked_seed(seed: int) -> int:
    from ..physics.errors import InputError

    if seed >= 2**64:
        raise InputError(f"--seed: found {seed}, wanted a whole number below 2^64")
    return seed


def chosen_estimators(names: str) -> dict[str, Any]:
    """Estimators by their names, with commas between them."""
    from ..estimators import METHODS
    from ..io.text.files import nearest
    from ..physics.errors import InputError

    chosen = {}
    for name in filter(None, (part.strip() for part in names.split(","))):
        if name not in METHODS:
            near = nearest(name, METHODS)
            hint = f" (did you mean {near}?)" if near else ""
            raise InputError(f"--methods: found {name!r}, wanted some of {', '.join(METHODS)}{hint}")
        chosen[name] = METHODS[name]()
    if not chosen:
        raise InputError(f"--methods: found none, wanted some of {', '.join(METHODS)}")
    return chosen


@contextmanager
def _store(study: Study, out: Path | None) -> Iterator[Store]:
    """Where chunks are kept: beside the results, or nowhere for longer than the command."""
    from tempfile import TemporaryDirectory

    from ..study.store import Store

    if out is not None:
        yield Store.open(out / "chunks", study)
        return
    with TemporaryDirectory(prefix="starplumb-") as folder:
        yield Store.open(Path(folder), study)


def _run(store: Store, scheduler: Scheduler, quiet: bool) -> None:
    """Run what is missing; on Ctrl-C say what is kept."""
    from ..study.run import run

    try:
        with _progress(store.study.trials, quiet) as done:
            run(store, scheduler, done)
    except KeyboardInterrupt:
        kept = store.study.trials - sum(store.study.count(c) for c in store.missing())
        if not quiet:
            print(
                f"starplumb: {kept} of {store.study.trials} trials are finished and kept in {store.folder}; "
                "the same command with the same --out resumes them",
                file=sys.stderr,
            )
        raise


@contextmanager
def _progress(trials: int, quiet: bool) -> Iterator[Callable[[int], None]]:
    """A bar with rate and remaining time on a terminal, nothing in a pipe."""
    if quiet or not sys.stderr.isatty():
        yield lambda count: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    rate = TextColumn("{task.fields[rate]}")
    bar = Progress(
        TextColumn("trials"),
        BarColumn(),
        MofNCompleteColumn(),
        rate,
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    )
    with bar:
        task = bar.add_task("trials", total=trials, rate="")

        def done(count: int) -> None:
            bar.update(task, advance=count)
            speed = bar.tasks[0].speed
            bar.update(task, rate="" if speed is None else f"{speed:.0f}/s")

        yield done


def _publish(store: Store, out: Path | None, format: Any, speak: Output) -> dict[str, Any]:
    """Write the results, if they are wanted, and return summary.json."""
    from ..io.results.samples import write_samples
    from ..io.text.write import json_text, publish
    from ..report import simulation_page
    from ..study.figures import figures
    from ..study.summary import summarise

    document: dict[str, Any] = summarise(store)
    if out is None:
        return document
    if format == "none" and not store.study.keep_samples:
        speak.detail("no samples are written")
    write_samples(store, out, format)
    files = {"summary.json": json_text(document), "report.html": simulation_page(document)}
    publish(out, files | figures(document))
    return document


def _tables(document: dict[str, Any]) -> Iterator[Table]:
    """One table for each method."""
    from rich.table import Table

    for name, method in document["methods"].items():
        table = Table(
            title=f"{name} in {document['scenario']}, {document['trials']} trials", title_justify="left"
        )
        for heading in ("arcsec about", "x", "y", "z"):
            table.add_column(heading, justify="right" if len(heading) == 1 else "left")
        axes = method["axes"].values()
        for label, key in (("mean", "mean_arcsec"), ("sigma", "sigma_arcsec"), ("rms", "rms_arcsec")):
            table.add_row(label, *(_with_error(axis[key]) for axis in axes))
        table.add_row("largest", *(_number(axis["max_arcsec"]) for axis in axes))
        table.add_row("stated sigma", *(_number(axis["stated_sigma_arcsec"]) for axis in axes))
        table.add_row("error / stated", *(_with_error(axis["error_over_stated"]) for axis in axes))
        table.add_row("rms / Cramer-Rao bound", *(_with_error(axis["rmse_over_bound"]) for axis in axes))
        yield table


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _with_error(interval: dict[str, Any] | None) -> str:
    if interval is None or interval["value"] is None:
        return "-"
    return f"{interval['value']:.4g} ± {0.5 * (interval['high'] - interval['low']):.2g}"


def _sentences(document: dict[str, Any]) -> Iterator[str]:
    for name, method in document["methods"].items():
        ce90 = method["ground"]["ce90_m"]
        if ce90 is not None:
            yield f"{name}: CE90 on the ground {ce90['value']:.4g} m (alignment error alone, centres of the images)"
        for sentence in method["verdict"]:
            yield f"{name}: {sentence}"
