"""Monte Carlo of a scenario."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ..disk.publish import Content
from ..io.results.samples import SAMPLES, Format, sample_files
from ..io.results.samples import choose as choose_samples
from ..physics.errors import ArgumentError
from ..report.page import Table
from ..study.cameras import asked_of
from ..study.monte_carlo import CHUNK
from ..study.monte_carlo import Study as Plan
from ..study.run import choose, run
from ..study.statistics import trials_for
from ..study.store import Store
from ..study.summary import SCHEMA, summarise
from .arguments import Count, Folder, Seed, Wanted, checked
from .calibration import estimators_of, method_of
from .frames import Frame
from .scenario import Scenario
from .show import Shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

Watched = Callable[[Plan], AbstractContextManager[Callable[[int], None]]]

MARK = ("summary.json", SCHEMA)
"""The mark of the files of a study, and its kind."""
STUDY_FILES = (SAMPLES, "report.html")
"""Files of every study beside it; the figures are named after the methods."""
Precision = Annotated[float, Wanted("a number from 1e-4 to 0.5", lambda value: 1e-4 <= value <= 0.5)]
Chunk = Annotated[int, Wanted("a whole number from 1 to 1,000,000", lambda value: 1 <= value <= 1_000_000)]
MOST_TRIALS = 1_000_000_000
Trials = Annotated[
    int, Wanted(f"a whole number from 2 to {MOST_TRIALS}", lambda value: 2 <= value <= MOST_TRIALS)
]
PRECISION = 0.01
"""To this part of itself each sigma is known (3 standard errors) where neither trials nor precision are given."""


@dataclass(frozen=True, repr=False, eq=False)
class Summary(Shown):
    """The accuracy that a study found.  ``document`` is ``summary.json``."""

    document: dict[str, Any]

    @property
    def frame(self) -> Frame:
        """A row for each method and axis."""
        rows = [
            (name, axis, *(_value(found[key]) for key in _FIGURES))
            for name, method in self.document["methods"].items()
            for axis, found in method["axes"].items()
        ]
        columns = [list(column) for column in zip(*rows, strict=True)]
        return Frame("Accuracy", ("method", "axis", *_FIGURES), tuple(columns))

    def to_frame(self) -> DataFrame:
        """A row for each method and axis, as a pandas data frame."""
        return self.frame.to_frame()

    @property
    def tables(self) -> Sequence[Table]:
        return [_table(name, self.document, method) for name, method in self.document["methods"].items()]

    @property
    def sentences(self) -> Sequence[str]:
        return list(_sentences(self.document))


@dataclass(frozen=True, repr=False, eq=False)
class Study(Shown):
    """A finished study: what :func:`starplumb.simulate` returns.  ``document`` is ``summary.json``."""

    document: dict[str, Any]
    notices: tuple[str, ...] = ()

    def summary(self) -> Summary:
        """Errors, sigmas and whether those stated hold, by method and axis."""
        return Summary(self.document)

    @checked
    def plot_errors(self, method: str | None = None) -> Figure:
        """Histograms of a method's errors about x, y, z, by default of the first method."""
        from ..report.simulation_figures import all_histograms

        return all_histograms(*self._of(method)).drawing

    @checked
    def plot_convergence(self, method: str | None = None) -> Figure:
        """Sigma over its final value against the number of trials."""
        from ..report.simulation_figures import convergence

        name, found = self._of(method)
        return convergence(name, found["convergence"]).drawing

    def _of(self, method: str | None) -> tuple[str, dict[str, Any]]:
        name = method_of(self.document, method)
        return name, self.document["methods"][name]

    @checked
    def save(self, folder: Folder) -> None:
        """Write ``summary.json``, ``report.html`` and the figures."""
        self._publish(Path(folder), {}, also=[SAMPLES])

    def _publish(
        self,
        folder: Path,
        samples: Mapping[str, Content],
        also: Sequence[str] = (),
        inputs: Sequence[Path] = (),
    ) -> None:
        from ..io.text.write import marked, publish
        from ..report.simulation import simulation_page
        from ..report.simulation_figures import simulation_files

        files = {"report.html": simulation_page(self.document), **simulation_files(self.document), **samples}
        mark = marked(MARK[0], self.document)
        publish(folder, files, [SAMPLES], mark=mark, also=also, inputs=inputs)

    @property
    def sentences(self) -> Sequence[str]:
        d = self.document
        return (
            f"Study of {d['scenario']}: {d['trials']} trials, seed {d['seed']}, methods {', '.join(d['methods'])}",
            "summary() shows what it found",
        )


@checked
def simulate(
    scenario: Scenario,
    trials: Trials | None = None,
    seed: Seed = 1,
    methods: Sequence[str] | str | None = None,
    *,
    precision: Precision | None = None,
    workers: Count | None = 1,
    scheduler: str | None = None,
    chunk: Chunk = CHUNK,
    out: Folder | None = None,
    samples: str = "none",
    watched: Watched = lambda plan: nullcontext(lambda trials: None),
) -> Study:
    """Say what accuracy a scenario gives, by trying it many times.

    ``methods`` are by default gls and wahba, of several cameras gls.  The answer depends on scenario, ``seed``,
    ``trials`` and ``chunk`` alone, not on ``workers`` (None: one for each processor) or a Dask ``scheduler``.  With
    ``precision`` the trials are chosen so that each sigma is known to this part of itself.  With ``out`` finished
    chunks are kept there, an interrupted study goes on where it stopped, and the results are written, with every trial
    as a table where ``samples`` names a format.  ``watched`` makes, of the study, a context in which it runs, whose
    value hears the number of trials of each chunk and, where it has a method ``works``, how many more of unfinished
    ones are done.
    """
    format: Format = choose_samples(samples) if out is not None or samples != "auto" else "none"
    if out is None and format != "none":
        raise ArgumentError("samples", f"found {samples!r} without out, wanted a folder to write them to")
    if methods is None:
        methods = ("gls", "wahba") if scenario.data.campaign.rig is None else "gls"
    study = Plan(
        scenario.data,
        dict(asked_of(scenario.data, estimators_of(methods))),
        seed,
        _number_of_trials(trials, precision),
        chunk,
        keep_samples=format != "none",
    )
    with _store(study, None if out is None else Path(out)) as store:
        with watched(study) as done:
            told = getattr(done, "works", lambda trials: None)
            notices = run(store, choose(workers, scheduler, study.chunks, told), done)
        found = Study(summarise(store), notices)
        if out is not None:
            found._publish(Path(out), sample_files(store, format))
        return found


def _number_of_trials(trials: int | None, precision: float | None) -> int:
    if trials is not None and precision is not None:
        raise ArgumentError("precision", "found beside trials, wanted only one of the two")
    if trials is None:
        return trials_for(PRECISION if precision is None else precision)
    return trials


@contextmanager
def _store(study: Plan, out: Path | None) -> Iterator[Store]:
    """Where chunks are kept: beside the results, or nowhere for longer than the study."""
    from tempfile import TemporaryDirectory

    if out is not None:
        there = out.exists(), (out / "chunks").exists()
        store = Store.open(out / "chunks", study)
        try:
            yield store
        except BaseException:
            if not there[1]:
                store.remove_empty(with_parent=not there[0])
            raise
        return
    with TemporaryDirectory(prefix="starplumb-") as folder:
        yield Store.open(Path(folder), study)


_FIGURES = (
    "mean_arcsec",
    "sigma_arcsec",
    "rms_arcsec",
    "max_arcsec",
    "stated_sigma_arcsec",
    "error_over_stated",
)


def _value(figure: Any) -> float:
    """A figure without its interval; NaN where it does not exist."""
    value = figure["value"] if isinstance(figure, dict) else figure
    return float("nan") if value is None else float(value)


def _table(name: str, document: dict[str, Any], method: dict[str, Any]) -> Table:
    axes = method["axes"].values()
    rows = [
        (label, *(_with_error(axis[key]) for axis in axes))
        for label, key in (("mean", "mean_arcsec"), ("sigma", "sigma_arcsec"), ("rms", "rms_arcsec"))
    ]
    rows.append(("largest", *(_number(axis["max_arcsec"]) for axis in axes)))
    rows.append(("stated sigma", *(_number(axis["stated_sigma_arcsec"]) for axis in axes)))
    rows.append(("error / stated", *(_with_error(axis["error_over_stated"]) for axis in axes)))
    rows.append(("rms / Cramer-Rao bound", *(_with_error(axis["rmse_over_bound"]) for axis in axes)))
    title = f"{name} in {document['scenario']}, {document['trials']} trials"
    return Table(title, ("arcsec about", "x", "y", "z"), rows)


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
