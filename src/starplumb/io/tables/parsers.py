"""Two parsers of well-kept libraries for plain rows of CSV: NumPy's, and several times quicker that of PyArrow.

Each is made for a header and the columns wanted of it, and takes whole lines (ASCII, LF, none of them blank, no quotes)
to the columns by name.  It raises ValueError, or gives nan, wherever it does not read what ``float`` would.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .header import Array, Wanted

Parsed = tuple[dict[str, Array], dict[str, list[str]]]
Parser = Callable[[bytes], Parsed]

WORTHWHILE = 1 << 22
"""Bytes of a file from which on PyArrow, where it is installed, makes up for its import (0.05 s)."""
_LETTERS = 16
_MOST_LETTERS = 1 << 10


def parser_for(size: int, header: Sequence[str], wanted: Wanted) -> Parser:
    """The quicker parser for a file of so many bytes."""
    if size >= WORTHWHILE:
        try:
            return arrow_parser(header, wanted)
        except ImportError:
            pass
    return numpy_parser(header, wanted)


def numpy_parser(header: Sequence[str], wanted: Wanted) -> Parser:
    """Parser by ``numpy.loadtxt``, which leaves numbers to the same function of Python as ``float`` does.

    It cuts a text that is longer than its cell: cells grow, from twice what the first row needs, until no text fills
    one.
    """
    texts = {name: str(header.index(name)) for name in wanted.texts_in(header)}
    numbers = {name: str(header.index(name)) for name in wanted.numbers_in(header)}
    letters = 0

    def rows_of(lines: list[str], letters: int) -> NDArray[Any]:
        kinds = ["f8" if name in numbers else f"U{letters}" if name in texts else "U1" for name in header]
        dtype = [(str(i), kind) for i, kind in enumerate(kinds)]
        return np.loadtxt(lines, dtype=dtype, delimiter=",", comments=None, ndmin=1)

    def parse(piece: bytes) -> Parsed:
        nonlocal letters
        lines = piece.decode("ascii").removesuffix("\n").split("\n")
        letters = letters or max(_LETTERS, 2 * max(map(len, lines[0].split(","))))
        rows = rows_of(lines, letters)
        while any(np.strings.str_len(rows[place]).max() == letters for place in texts.values()):
            letters *= 4
            if letters > _MOST_LETTERS:
                raise ValueError("a very long text")
            rows = rows_of(lines, letters)
        return (
            {name: rows[place].copy() for name, place in numbers.items()},
            {name: rows[place].tolist() for name, place in texts.items()},
        )

    return parse


def arrow_parser(header: Sequence[str], wanted: Wanted) -> Parser:
    """Parser by PyArrow, whose numbers are rounded correctly, as Python's are. Raises ImportError without it."""
    import pyarrow
    from pyarrow import csv

    texts = {name: str(header.index(name)) for name in wanted.texts_in(header)}
    numbers = {name: str(header.index(name)) for name in wanted.numbers_in(header)}
    types = dict.fromkeys(texts.values(), pyarrow.string())
    types |= dict.fromkeys(numbers.values(), pyarrow.float64())
    convert_options = csv.ConvertOptions(column_types=types, include_columns=list(types), check_utf8=False)

    def parse(piece: bytes) -> Parsed:
        read_options = csv.ReadOptions(
            use_threads=False, block_size=len(piece) + 1, column_names=[str(i) for i in range(len(header))]
        )
        rows = csv.read_csv(pyarrow.BufferReader(piece), read_options, convert_options=convert_options)
        return (
            {name: rows[place].to_numpy() for name, place in numbers.items()},
            {name: rows[place].to_pylist() for name, place in texts.items()},
        )

    return parse
