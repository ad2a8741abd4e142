"""Vendors' metadata as a tree of named values, with a sentence for whatever is missing or is not what it should be.

Names are matched without regard to case: the vendors' text and XML forms differ in nothing else.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import EpochError, InputError
from ...physics.timescales import parse
from .files import read_bytes, show
from .numbers import LEAST, MOST, numbers
from .xml_tree import parse_xml

Array = NDArray[np.float64]
Epochs = NDArray[np.int64]


@dataclass(frozen=True)
class Node:
    """An element of the file ``path``; ``place`` is where it stands, in words for the user."""

    path: Path
    element: Element
    place: str = ""

    def error(self, found: str, wanted: str) -> InputError:
        """The sentence about this element."""
        where = f"{self.path}, {self.place}" if self.place else str(self.path)
        return InputError(f"{where}: found {found}, wanted {wanted}")

    @property
    def name(self) -> str:
        return self.element.tag

    @property
    def text(self) -> str:
        return (self.element.text or "").strip()

    def all(self, key: str) -> list[Node]:
        """Children of that name; ``NAME_1``, ``NAME_2``... count as ``NAME``, as the vendors number groups."""
        wanted = re.compile(rf"{re.escape(key)}(_\d+)?", re.IGNORECASE)
        children = [child for child in self.element if wanted.fullmatch(child.tag)]
        many = len(children) > 1
        return [
            Node(self.path, child, self._inside(child) + (f"[{i}]" if many else ""))
            for i, child in enumerate(children, 1)
        ]

    def below(self, key: str) -> list[Node]:
        """The elements of that name at any depth below this one."""
        found = [
            node for child in self.element for node in Node(self.path, child, self._inside(child)).below(key)
        ]
        return [*self.all(key), *found]

    def _inside(self, child: Element) -> str:
        return f"{self.place}/{child.tag}" if self.place else child.tag

    def find(self, keys: str) -> Node | None:
        """The first element at ``A/B/C`` below this one, or None."""
        node: Node | None = self
        for key in keys.split("/"):
            node = node._first(key) if node else None
        return node

    def _first(self, key: str) -> Node | None:
        """The first child of that name.  Raises InputError where several hold texts that differ."""
        found = self.all(key)
        if len(found) > 1 and len({node.text for node in found if not len(node.element)}) > 1:
            raise self.error(f"{len(found)} times {key}, each with another value", "one")
        return found[0] if found else None

    def need(self, keys: str) -> Node:
        """As :meth:`find`. Raises InputError where it is missing."""
        node = self
        for key in keys.split("/"):
            below = node._first(key)
            if below is None:
                raise node.error(f"no {key}", f"the key {keys}")
            node = below
        return node

    def one(self, keys: str) -> Node:
        """As :meth:`need`, where a second one would leave open which is meant."""
        parent, _, key = keys.rpartition("/")
        above = self.need(parent) if parent else self
        found = above.all(key)
        if len(found) > 1:
            raise above.error(f"{len(found)} times {key}", "one")
        return found[0] if found else above.need(key)

    def unit(self, factors: Mapping[str, float]) -> float | None:
        """Factor to SI of the attribute ``unit``, None where it has none. Raises InputError for another unit."""
        stated = self.element.get("unit")
        if stated is None:
            return None
        if stated not in factors:
            raise self.error(f"the unit {show(stated)}", f"one of {', '.join(factors)}")
        return factors[stated]

    def numbers(self, count: int | None = None) -> Array:
        """Finite numbers separated by blanks or commas, ``count`` of them or, for None, at least one."""
        words = self.text.replace(",", " ").split()
        values = numbers(words)
        if not words or not np.isfinite(values).all() or count not in (None, len(words)):
            wanted = {None: "numbers", 1: "a number"}.get(count, f"{count} numbers")
            raise self.error(show(self.text), wanted)
        return values

    def number(self) -> float:
        return float(self.numbers(1)[0])

    def positive(self) -> float:
        value = self.number()
        if not LEAST <= value <= MOST:
            raise self.error(show(self.text), f"a positive number, {LEAST:g} to {MOST:g}")
        return value

    def whole(self, least: int = 0) -> int:
        """A whole number, not below ``least``."""
        value = self.number()
        if value != int(value) or value < least:
            raise self.error(show(self.text), f"a whole number, at least {least}")
        return int(value)

    def epoch(self, scale: str = "UTC") -> int:
        """``t_ns`` of the time written here."""
        return self.epoch_of(self.text, scale)

    def epoch_of(self, text: str, scale: str = "UTC") -> int:
        """``t_ns`` of the time ``text``, another writing of the one here."""
        try:
            return int(parse([text], scale)[0])
        except EpochError as error:
            raise self.error(show(self.text), f"a time ({error})") from None


def require_increasing(nodes: list[Node], t_ns: Epochs) -> None:
    """Raise InputError about the first of the samples (n,) that is not later than the one before."""
    late = np.diff(t_ns) <= 0
    if late.any():
        raise nodes[int(np.argmax(late)) + 1].error(
            "a time not later than the one before", "times that increase"
        )


def read_xml(path: Path) -> Node:
    """The root element of an XML file.

    Raises InputError for a file that is missing, too large, not well formed or has a DOCTYPE.
    """
    return Node(path, parse_xml(str(path), read_bytes(path)))
