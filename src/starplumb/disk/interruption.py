"""Being asked to stop: SIGTERM and SIGHUP end a command as Ctrl-C does, but not between the renames of one set."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from types import FrameType

ASKS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals by which a process is asked to stop; SIGKILL does not ask."""


class Stopped(KeyboardInterrupt):
    """This process was asked to stop by another signal than that of Ctrl-C."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number


def stop_as_by_ctrl_c() -> None:
    """From now on SIGTERM and SIGHUP raise :class:`Stopped`, a KeyboardInterrupt, where they would end the process.

    What was ignored when the process began (``nohup``) stays so.
    """
    for number in ASKS:
        if number != signal.SIGINT and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _stop)


def name_of(number: int) -> str:
    """The name of a signal."""
    return "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name


def _stop(number: int, frame: FrameType | None) -> None:
    raise Stopped(number)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Signals that ask to stop wait until the block is done.

    They are noted, not blocked: whichever thread receives a signal, Python handles it in the main one.
    """
    if current_thread() is not main_thread():
        yield
        return
    asked: list[int] = []
    before = {number: signal.getsignal(number) for number in ASKS}
    handled = {number: handler for number, handler in before.items() if handler not in (None, signal.SIG_IGN)}
    for number in handled:
        signal.signal(number, lambda number, _frame: asked.append(number))
    try:
        yield
    finally:
        for number, handler in handled.items():
            signal.signal(number, handler)
        if asked:
            signal.raise_signal(asked[0])
