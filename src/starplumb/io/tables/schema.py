"""The columns that a table must have and may have, and the check of a header against them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

from ...physics.errors import InputError
from ..text.files import nearest, show

Value = str | bool | int | float
"""The value that a cell is compared with."""


SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
"""What may stand between the cells of a text file."""


@dataclass(frozen=True)
class Schema:
    """Names of text and number columns that a table must have, and of those that it may have.

    ``stamps`` are columns of times, text or numbers; ``keep`` has the values, one of several, that a row must have in
    some columns to be looked at; ``may_be_empty`` admits a header without rows; ``separator`` stands between the cells
    of a text file, ``decimal`` before the decimals of its numbers; ``like`` are patterns of number columns that a table
    may have, as in ``temperature_*_c``; ``unknown`` are number columns whose cells may be empty (NaN) or
    ``inf``; ``instead`` are number columns that may all stand in place of one, of which
    the first tells that they do.
    """

    texts: Sequence[str] = ()
    numbers: Sequence[str] = ()
    optional_texts: Sequence[str] = ()
    optional_numbers: Sequence[str] = ()
    stamps: Sequence[str] = ()
    keep: Mapping[str, tuple[Value, ...]] = field(default_factory=dict)
    may_be_empty: bool = False
    separator: str = ","
    decimal: str = "."
    like: Sequence[str] = ()
    instead: Mapping[str, Sequence[str]] = field(default_factory=dict)
    unknown: Sequence[str] = ()

    def texts_in(self, header: Sequence[str]) -> list[str]:
        """Text columns to read."""
        return [name for name in (*self.texts, *self.optional_texts) if name in header]

    def kept(self, cells: Mapping[str, object]) -> bool:
        """Whether a row with these cells is kept."""
        return all(
            any(_alike(cells.get(name), value) for value in values) for name, values in self.keep.items()
        )

    def numbers_in(self, header: Sequence[str]) -> list[str]:
        """Number columns to read."""
        asked = (*self.numbers, *self.optional_numbers)
        replacing = [name for one, others in self.instead.items() if one not in header for name in others]
        named = [name for name in (*asked, *replacing) if name in header]
        return [*named, *(name for name in header if self.alike(name) and name not in named)]

    def alike(self, name: str) -> bool:
        """Whether a name is like those of number columns that a table may have."""
        return any(fnmatchcase(name, pattern) for pattern in self.like)

    def ignored(self, header: Sequence[str]) -> list[str]:
        """Columns that are not used."""
        known = {*self.texts_in(header), *self.numbers_in(header), *self.stamps, *self.keep}
        return [name or "(unnamed)" for name in header if name not in known]

    def check(self, where: str, header: Sequence[str]) -> None:
        """Raise InputError where the header at ``where`` is empty, split otherwise, doubled or incomplete."""
        needed = list(dict.fromkeys([*self.texts, *self.numbers, *self.stamps, *self.keep]))
        if not header:
            raise InputError(f"{where}: found no header, wanted the columns {', '.join(needed)}")
        for mark, name in SEPARATORS.items():
            if len(header) == 1 and mark in header[0]:
                raise InputError(
                    f"{where}: found columns separated by {name}, wanted {SEPARATORS[self.separator]} (or separator = "
                    f'{show(mark)} stated beside the file, and decimal = "," where its numbers have decimal commas)'
                )
        doubled = [name for name, count in Counter(header).items() if count > 1 and name]
        if doubled:
            raise InputError(f"{where}: found the column {show(doubled[0])} more than once, wanted it once")
        for one, others in self.instead.items():
            if one in header and others[0] in header:
                found = f"found the columns {one} and {others[0]}, wanted only one of the two"
                raise InputError(f"{where}: {found}")
            if one not in header and others[0] in header:
                needed = [name for name in (*needed, *others) if name != one]
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


def _alike(cell: object, wanted: Value) -> bool:
    """Whether a cell, as text or as a value, equals what is wanted: numbers by value, all else by its text."""
    if isinstance(wanted, bool):
        return str(cell).strip().lower() == str(wanted).lower()
    if isinstance(wanted, str):
        return str(cell).strip() == wanted
    try:
        return not isinstance(cell, bool) and float(str(cell)) == wanted
    except ValueError:
        return False
