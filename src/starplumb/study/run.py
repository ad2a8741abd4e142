"""Where the chunks run: in this process, in others on this machine, or on a Dask cluster, with the same answer."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from itertools import islice
from multiprocessing import parent_process
from threading import Thread
from typing import TYPE_CHECKING, Any, Protocol

from ..disk.interruption import uninterrupted
from ..physics.errors import ArgumentError, InputError
from .monte_carlo import Arrays, Study
from .store import Store
from .threads import one_thread

if TYPE_CHECKING:
    from concurrent.futures import Future

AHEAD = 2
"""Chunks given out per worker beyond the one it works on: enough to keep it busy, few enough to stop quickly."""
LOOK_S = 0.25
"""Seconds from one look at what the workers have done to the next."""
NAMED = 3
"""So many spoilt chunks are named."""
LOST_POOLS = 5
"""How often the workers may die without finishing a chunk before the study ends with an error."""


class Scheduler(Protocol):
    """Runs chunks in any order and yields each as it is done."""

    def results(self, study: Study, chunks: Sequence[int]) -> Iterator[tuple[int, Arrays]]: ...


def _nothing(trials: int) -> None:
    """What nobody wants to hear."""


@dataclass(frozen=True)
class Serial:
    """One after another in this process."""

    told: Callable[[int], None] = field(default=_nothing, compare=False, repr=False)

    def results(self, study: Study, chunks: Sequence[int]) -> Iterator[tuple[int, Arrays]]:
        for c in chunks:
            yield c, study.run(c, self.told)


_study: Study | None = None
"""The study of a worker process, set once when it starts."""
_done: Any = None
"""How many trials all workers have done, shared between them."""


def _start_worker(study: Study, done: Any) -> None:
    global _study, _done
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent stops its workers
    Thread(target=_end_with_parent, daemon=True).start()
    _study, _done = study, done


def _count(trials: int) -> None:
    with _done.get_lock():
        _done.value += trials


def _end_with_parent() -> None:
    """End this worker when its parent ends: a parent that is killed cannot stop its workers."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _run_in_worker(c: int) -> Arrays:
    assert _study is not None  # the pool's initializer set it
    return _study.run(c, _count)


@dataclass(frozen=True)
class Processes:
    """Worker processes of one thread each; when one is killed, what it had not finished is run again."""

    workers: int
    told: Callable[[int], None] = field(default=_nothing, compare=False, repr=False)

    def results(self, study: Study, chunks: Sequence[int]) -> Iterator[tuple[int, Arrays]]:
        from concurrent.futures.process import BrokenProcessPool

        left, lost = list(chunks), 0
        while left:
            try:
                for c, arrays in self._pool(study, tuple(left)):
                    left.remove(c)
                    lost = 0
                    yield c, arrays
            except BrokenProcessPool:
                lost += 1
                if lost >= LOST_POOLS:
                    raise InputError(
                        f"worker processes were killed {lost} times before they finished a chunk, "
                        "wanted more memory or fewer workers"
                    ) from None

    def _pool(self, study: Study, chunks: tuple[int, ...]) -> Iterator[tuple[int, Arrays]]:
        from concurrent.futures import ProcessPoolExecutor
        from multiprocessing import get_context

        workers, spawn, heard = min(self.workers, len(chunks)), get_context("spawn"), 0
        counter = spawn.Value("q", 0)
        pool = ProcessPoolExecutor(workers, spawn, _start_worker, (study, counter))

        def look() -> None:
            nonlocal heard
            heard, before = counter.value, heard
            self.told(heard - before)

        try:
            with one_thread():
                yield from _windowed(chunks, AHEAD * workers, lambda c: pool.submit(_run_in_worker, c), look)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _windowed(
    chunks: Sequence[int], window: int, submit: Callable[[int], Future[Arrays]], look: Callable[[], None]
) -> Iterator[tuple[int, Arrays]]:
    """Results as they come, never more than ``window`` chunks given out at once; ``look`` is called while waiting."""
    queue, running = iter(chunks), {}
    for c in queue:
        running[submit(c)] = c
        if len(running) < window:
            continue
        yield from _collect(running, _first_of(running, look))
    while running:
        yield from _collect(running, _first_of(running, look))


def _first_of(running: Iterable[Future[Arrays]], look: Callable[[], None]) -> set[Future[Arrays]]:
    """Those of the running ones that are done, at least one."""
    from concurrent.futures import FIRST_COMPLETED, wait

    while True:
        done = wait(running, LOOK_S, FIRST_COMPLETED).done
        look()
        if done:
            return done


def _collect(running: dict[Future[Arrays], int], done: set[Future[Arrays]]) -> Iterator[tuple[int, Arrays]]:
    for future in done:
        yield running.pop(future), future.result()


def _run_on_cluster(study: Study, c: int) -> Arrays:
    return study.run(c)


@contextmanager
def _silent(package: str) -> Iterator[None]:
    """Nothing is logged by a package, whose parts may have levels and handlers of their own."""
    names = [
        name for name in logging.root.manager.loggerDict if name == package or name.startswith(f"{package}.")
    ]
    before = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)


@dataclass(frozen=True)
class Dask:
    """Workers of a Dask cluster (extra ``cluster``); a task is a chunk, and the cluster repeats those it loses."""

    address: str

    def results(self, study: Study, chunks: Sequence[int]) -> Iterator[tuple[int, Arrays]]:
        try:
            distributed: Any = import_module("distributed")
        except ImportError:
            raise ArgumentError(
                "scheduler", "found no Dask, which it needs: pip install 'starplumb[cluster]'"
            ) from None
        try:
            client = distributed.Client(self.address, timeout=20)
        except (OSError, ValueError, TimeoutError) as error:
            raise ArgumentError("scheduler", f"found no Dask scheduler at {self.address} ({error})") from None
        try:
            with _silent("distributed"):  # a scheduler that dies is told below, in one sentence
                yield from self._with(client, distributed, study, chunks)
        except (OSError, TimeoutError, distributed.CancelledError):
            raise ArgumentError(
                "scheduler", f"found the one at {self.address} gone before the study was finished"
            ) from None

    def _with(
        self, client: Any, distributed: Any, study: Study, chunks: Sequence[int]
    ) -> Iterator[tuple[int, Arrays]]:
        with client:
            everywhere = client.scatter(study, broadcast=True)

            def submit(c: int) -> Any:
                return client.submit(_run_on_cluster, everywhere, c, pure=False, retries=LOST_POOLS)

            queue = iter(chunks)
            window = max(AHEAD * len(client.nthreads()), AHEAD)
            running = {submit(c): c for c in islice(queue, window)}
            finished = distributed.as_completed(running)
            for future in finished:
                yield running.pop(future), future.result()
                if (c := next(queue, None)) is not None:
                    running[fresh := submit(c)] = c
                    finished.add(fresh)


def cpu_count() -> int:
    """Processors that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


def choose(
    workers: int | None, address: str | None, chunks: int, told: Callable[[int], None] = _nothing
) -> Scheduler:
    """The scheduler for the options: a cluster where an address is given, this process for one worker or chunk, else
    worker processes; ``told`` hears how many more trials of unfinished chunks are done (not of a cluster)."""
    if address is not None:
        return Dask(address)
    count = min(cpu_count() if workers is None else workers, chunks)
    return Serial(told) if count <= 1 else Processes(count, told)


def run(
    store: Store, scheduler: Scheduler, done: Callable[[int], None] = lambda trials: None
) -> tuple[str, ...]:
    """Run what is missing of a study; ``done`` gets the number of trials of each chunk, first of those on disk.

    A chunk counts once it is stored: interrupted at any moment, the finished ones are kept.  Returns what the user
    should know: which chunks were spoilt and have been computed again.
    """
    study = store.study
    missing = store.missing()
    spoilt = store.spoilt(missing)
    done(study.trials - sum(study.count(c) for c in missing))
    for c, arrays in scheduler.results(study, missing):
        with uninterrupted():  # what is kept is counted
            store.save(c, arrays)
            done(study.count(c))
    if not spoilt:
        return ()
    names = ", ".join(path.name for path in spoilt[:NAMED]) + (", ..." if len(spoilt) > NAMED else "")
    found = f"found {len(spoilt)} chunks that are damaged or of another study ({names})"
    return (f"{store.folder}: {found}; they were computed again",)
