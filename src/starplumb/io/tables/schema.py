"""The columns that a table must have and may have, and the check of a header against them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from ...physics.errors import InputError
from ..text.files import nearest, show


@dataclass(frozen=True)
class Schema:
    """Names of text and number columns that a table must have, and of those that it may have."""

    texts: Sequence[str] = ()
    numbers: Sequence[str] = ()
    optional_texts: Sequence[str] = ()
    optional_numbers: Sequence[str] = ()

    def texts_in(self, header: Sequence[str]) -> list[str]:
        """Text columns to read."""
        return [name for name in (*self.texts, *self.optional_texts) if name in header]

    def numbers_in(self, header: Sequence[str]) -> list[str]:
        """Number columns to read."""
        return [name for name in (*self.numbers, *self.optional_numbers) if name in header]

    def ignored(self, header: Sequence[str]) -> list[str]:
        """Columns that nobody asks for."""
        known = {*self.texts_in(header), *self.numbers_in(header)}
        return [name or "(unnamed)" for name in header if name not in known]

    def check(self, where: str, header: Sequence[str]) -> None:
        """Raise InputError where the header at ``where`` is empty, split otherwise, doubled or incomplete."""
        needed = [*self.texts, *self.numbers]
        if not header:
            raise InputError(f"{where}: found no header, wanted the columns {', '.join(needed)}")
        for mark, name in ((";", "semicolons"), ("\t", "tabs")):
            if len(header) == 1 and mark in header[0]:
                raise InputError(
                    f"{where}: found columns separated by {name}, wanted commas (and decimal points)"
                )
        doubled = [name for name, count in Counter(header).items() if count > 1 and name]
        if doubled:
            raise InputError(f"{where}: found the column {show(doubled[0])} more than once, wanted it once")
        lacking = [name for name in needed if name not in header]
        if lacking:
            known = (*needed, *self.optional_texts, *self.optional_numbers)
            near = nearest(lacking[0], [name for name in header if name not in known])
            hint = f" (did you mean {show(near)}?)" if near else ""
            columns = "the columns" if len(lacking) > 1 else "the column"
            found = show(", ".join(header))
            raise InputError(
                f"{where}: found the header {found}, wanted {columns} {', '.join(lacking)} too{hint}"
            )
