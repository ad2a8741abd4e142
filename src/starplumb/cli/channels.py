"""Standard output and error as they may be: full, closed, narrow, a terminal that obeys what is written to it."""

from __future__ import annotations

import errno
import io
import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, BinaryIO, cast

import typer
from typer.core import TyperGroup

from ..disk.interruption import Stopped
from ..io.text.visible import OBEYED, visible

if TYPE_CHECKING:
    from typing_extensions import Buffer

_IN_JSON = {code: f"\\u{code:04x}" for code in OBEYED}
_NO_OUTPUT = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)


class Interrupted(BaseException):
    """The command was asked to stop, by the signal of this number; ``kept`` says what of its work stays."""

    def __init__(self, number: int, kept: str = "") -> None:
        super().__init__()
        self.number, self.kept = number, kept

    @classmethod
    def of(cls, error: KeyboardInterrupt, kept: str = "") -> Interrupted:
        return cls(error.number if isinstance(error, Stopped) else 2, kept)


class Commands(TyperGroup):
    """All commands; one that is asked to stop says by what."""

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Read the command line.  Raises Interrupted, as ``invoke`` does."""
        with _saying_why():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: Any) -> Any:
        """Run the command.  Raises Interrupted where typer would see a KeyboardInterrupt and say nothing."""
        with _saying_why():
            return super().invoke(ctx)


@contextmanager
def _saying_why() -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt as error:
        raise Interrupted.of(error) from None


def prepare() -> None:
    """Have all three channels open, so that no file is taken for one; and no character that cannot be written."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, PTH123
        if isinstance(channel := getattr(sys, name), io.TextIOWrapper):
            channel.reconfigure(errors="backslashreplace")
            setattr(sys, name, _for_any_reader(channel))


class _Unread(io.FileIO):
    """A channel whose reader may go: what is written to it then goes nowhere, and the command goes on."""

    def write(self, data: Buffer, /) -> int:
        try:
            return super().write(data) or 0
        except BrokenPipeError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)
            return super().write(data) or 0


def _for_any_reader(channel: io.TextIOWrapper) -> io.TextIOWrapper:
    """The same channel for a reader that may go; one that is not of this process as it is."""
    unbuffered = isinstance(channel.buffer, io.FileIO)  # python -u
    if type(channel.buffer if unbuffered else getattr(channel.buffer, "raw", None)) is not io.FileIO:
        return channel
    channel.flush()
    to = _Unread(channel.fileno(), "w", closefd=False)
    return io.TextIOWrapper(
        cast(BinaryIO, to if unbuffered else io.BufferedWriter(to)),
        channel.encoding,
        channel.errors,
        line_buffering=channel.line_buffering,
        write_through=channel.write_through,
    )


def finish(run: Callable[[], None]) -> None:
    """Run, and write out all that was said.  Raises OSError where standard output takes no more."""
    try:
        run()
    finally:
        sys.stdout.flush()


def is_of_output(error: OSError) -> bool:
    """Whether an error is that of standard output: no file has a name in it."""
    return error.filename is None and error.errno in _NO_OUTPUT


def forget_output() -> None:
    """What standard output did not take is not tried again when Python ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def print_json(document: dict[str, Any] | list[dict[str, Any]]) -> None:
    """A document on standard output, in ASCII where that takes no more."""
    narrow = not (sys.stdout.encoding or "utf-8").lower().startswith("utf")
    text = json.dumps(document, indent=1, ensure_ascii=narrow, allow_nan=False)
    typer.echo(text.translate(_IN_JSON))


def print_csv(text: str) -> None:
    """A table on standard output: in UTF-8, as every reader wants it, but visible on a terminal."""
    if sys.stdout.isatty():
        typer.echo(visible(text), nl=False)
    elif isinstance(sys.stdout, io.TextIOWrapper):
        typer.echo(text.encode("utf-8", "backslashreplace"), nl=False)
    else:
        typer.echo(text, nl=False)


def complain(text: str) -> None:
    """One line on standard error; where that takes none there is nobody to tell."""
    with suppress(OSError):
        print(f"starplumb: {visible(' '.join(text.split()))}", file=sys.stderr)
