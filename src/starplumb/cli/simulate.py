"""``starplumb simulate``: Monte Carlo of a scenario."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .channels import Interrupted
from .options.common import ScenarioArgument
from .options.complete import methods as names
from .options.complete import samples as complete_samples
from .options.places import require_place
from .output import Json, Output, Quiet, Verbose

if TYPE_CHECKING:
    from ..study.monte_carlo import Study


def simulate(
    scenario: ScenarioArgument,
    trials: Annotated[
        int | None,
        typer.Option("--trials", "-n", metavar="COUNT", min=2, max=1_000_000_000, help="Number of trials."),
    ] = None,
    precision: Annotated[
        float | None,
        typer.Option(
            "--precision",
            metavar="PART",
            min=1e-4,
            max=0.5,
            help="Choose the trials so that each sigma is known to this part of itself (3 standard errors) "
            "[default: 0.01, which is 45000 trials].",
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option("--seed", "-s", metavar="NUMBER", min=0, help="Seed of the draws.")
    ] = 1,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="Folder of the results; also resumes there."),
    ] = None,
    methods: Annotated[
        str | None,
        typer.Option(
            "--methods",
            "-m",
            metavar="NAME,...",
            help="Estimators, with commas between them [default: gls,wahba; of several cameras gls].",
            autocompletion=names,
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            "--workers",
            "-w",
            metavar="COUNT",
            min=1,
            max=1000,
            help="Worker processes [default: one per processor].",
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler", metavar="ADDRESS", help="Address of a Dask scheduler that runs the chunks instead."
        ),
    ] = None,
    chunk: Annotated[
        int,
        typer.Option(
            "--chunk",
            metavar="COUNT",
            min=1,
            max=100_000,
            help="Trials of a chunk; the draws depend on it.",
        ),
    ] = 4096,
    samples: Annotated[
        str,
        typer.Option(
            "--samples",
            metavar="auto|parquet|none",
            autocompletion=complete_samples,
            help="Every trial as a table.",
        ),
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
    from ..session.scenario import scenario as read
    from ..session.study import MARK, STUDY_FILES
    from ..session.study import simulate as run

    speak = Output(json, quiet, verbose)

    def watched(plan: Study) -> AbstractContextManager[Callable[[int], None]]:
        speak.detail(f"{plan.trials} trials in {plan.chunks} chunks of {plan.chunk}")
        return _resumable(plan, out, quiet)

    asked = read(scenario)
    if out is not None:
        require_place(out, [MARK[0], *STUDY_FILES], [scenario], MARK)
    study = run(
        asked,
        trials,
        seed,
        methods,
        precision=precision,
        workers=workers,
        scheduler=scheduler,
        chunk=chunk,
        out=out,
        samples=samples,
        watched=watched,
    )
    speak.notices(study.notices)
    speak.document(study.document)
    speak.shown(
        study.summary(),
        "nothing written (--out DIR writes report, samples and figures)"
        if out is None
        else f"written: {out}",
    )
    _refuse_failures(study.document)


def _refuse_failures(document: dict[str, Any]) -> None:
    """Raise AlignmentFailed where a method failed in every run: its figures say nothing about its accuracy."""
    from ..physics.errors import AlignmentFailed

    failed = [name for name, method in document["methods"].items() if method["failed"] == document["trials"]]
    if failed:
        raise AlignmentFailed(
            f"{document['scenario']}: {', '.join(failed)} failed in all {document['trials']} runs, so the "
            "figures say nothing about its accuracy; wanted another method, or another scenario"
        )


@dataclass
class _Trials:
    """How many trials are finished and kept, and how many of unfinished chunks are done; ``show`` hears the sum."""

    show: Callable[[int], None]
    kept: int = 0
    unfinished: int = 0

    def __call__(self, count: int) -> None:
        """So many more are kept."""
        self.kept += count
        self.unfinished = max(self.unfinished - count, 0)
        self.show(self.kept + self.unfinished)

    def works(self, count: int) -> None:
        """So many more of unfinished chunks are done."""
        self.unfinished += count
        self.show(self.kept + self.unfinished)


@contextmanager
def _resumable(plan: Study, out: Path | None, quiet: bool) -> Iterator[Callable[[int], None]]:
    """The progress bar; where the work ends before it is done say what is kept."""
    from ..physics.errors import InputError

    trials = _Trials(lambda count: None)
    try:
        with _progress(plan.trials, quiet) as trials.show:
            yield trials
    except (KeyboardInterrupt, InputError) as error:
        if not trials.kept or out is None:
            raise
        told = (
            f"; {trials.kept} of {plan.trials} trials are finished and kept in {out / 'chunks'}, "
            "the same command with the same --out resumes them"
        )
        if isinstance(error, KeyboardInterrupt):
            raise Interrupted.of(error, told) from None
        raise InputError(f"{error}{told}") from None


@contextmanager
def _progress(trials: int, quiet: bool) -> Iterator[Callable[[int], None]]:
    """A bar with rate and remaining time on a terminal, nothing in a pipe; it hears how many trials are done."""
    if quiet or not sys.stderr.isatty():
        yield lambda count: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    rate = TextColumn("{task.fields[rate]}")
    bar = Progress(
        SpinnerColumn(),  # turns where many trials are done at once
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        rate,
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    )
    with bar:
        task = bar.add_task("trials", total=trials, rate="")

        def show(count: int) -> None:
            bar.update(task, completed=min(count, trials))
            speed = bar.tasks[0].speed
            bar.update(task, rate="" if speed is None else f"{speed:.0f}/s")

        yield show
