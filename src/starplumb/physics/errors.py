"""Errors that a user can correct: one sentence with the file, the row or key, what was found and what is wanted.

And words for such sentences.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

LONGEST_WORD = 500
"""More than any path that somebody types."""
_KEPT = 60
_TOO_LONG = re.compile(rf"\S{{{LONGEST_WORD + 1},}}")


class StarplumbError(Exception):
    """Base of every error starplumb raises on purpose; its text is meant for the user as it stands.

    Of what it echoes of a file or its name, letters that a terminal would act upon are escaped, and words of more than
    :data:`LONGEST_WORD` letters cut, whichever reader repeats them.
    """

    def __init__(self, message: str = "") -> None:
        message = _TOO_LONG.sub(lambda word: f"{word[0][:_KEPT]}...", message)
        super().__init__(message if message.isprintable() else "".join(map(_printable, message)))


def _printable(letter: str) -> str:
    return letter if letter.isprintable() else repr(letter)[1:-1]


class InputError(StarplumbError):
    """The input is unusable (exit status 2 of the commands)."""


class ArgumentError(InputError):
    """An argument of a function is unusable; at the command line it is the option of that name."""

    def __init__(self, argument: str, message: str) -> None:
        super().__init__(f"{argument}: {message}")
        self.argument = argument

    @property
    def as_option(self) -> str:
        """The text with the argument written as an option."""
        return f"--{self.argument.replace('_', '-')}{str(self).removeprefix(self.argument)}"


def nearest(word: str, known: Iterable[str]) -> str | None:
    """The known name that ``word`` most likely means, or None."""
    from difflib import get_close_matches

    by_lower = {name.lower(): name for name in known}
    close = get_close_matches(word.lower(), by_lower, n=1, cutoff=0.6)
    return by_lower[close[0]] if close else None


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """What ends a sentence about an unknown name: the known one that is most likely meant; nothing where none is."""
    near = nearest(word, known)
    return f" (did you mean {near}?)" if near else ""


def counted(n: int, one: str, several: str | None = None) -> str:
    """``1 image``, ``2 images``."""
    return f"{n} {one if n == 1 else several or f'{one}s'}"


class EpochError(InputError):
    """An epoch lies outside a series, in one of its gaps, or outside a table of Earth orientation or leap seconds.

    ``row`` is the index of the first offending epoch among those asked for; callers that know which image or file
    the epoch belongs to re-raise with that name.
    """

    def __init__(self, message: str, row: int = 0) -> None:
        super().__init__(message)
        self.row = row


class AlignmentFailed(StarplumbError):
    """The work was done but the answer must not be used (exit status 3); the text is the estimate's own message."""
