"""CCSDS messages in keyword = value notation (KVN): text to :class:`Message` and back."""

from __future__ import annotations

from collections.abc import Iterator

from ...physics.errors import InputError
from ..text.files import cut, show
from .ccsds_message import Dialect, Entry, Message, Segment, set_version

_MARKS = frozenset(
    {"META_START", "META_STOP", "DATA_START", "DATA_STOP", "COVARIANCE_START", "COVARIANCE_STOP"}
)
_HEADER, _METADATA, _DATA, _COVARIANCE = "the header", "the metadata", "the data", "a covariance"
_BEFORE_DATA, _AFTER_DATA = "the lines before DATA_START", "the lines after DATA_STOP"


class _Parser:
    """What a line means depends on where in the file it stands, which is ``place``."""

    def __init__(self, path: str, dialect: Dialect) -> None:
        self.message = Message(path, named_columns=False)
        self.dialect = dialect
        self.place = _HEADER
        self.segment = Segment()
        self.steps = {
            (_HEADER, "META_START"): _METADATA,
            (_METADATA, "META_STOP"): _BEFORE_DATA if dialect.data_marks else _DATA,
        }
        if dialect.data_marks:
            self.steps |= {
                (_BEFORE_DATA, "DATA_START"): _DATA,
                (_DATA, "DATA_STOP"): _AFTER_DATA,
                (_AFTER_DATA, "META_START"): _METADATA,
            }
        else:
            self.steps |= {
                (_DATA, "META_START"): _METADATA,
                (_DATA, "COVARIANCE_START"): _COVARIANCE,
                (_COVARIANCE, "COVARIANCE_STOP"): _DATA,
            }

    def take(self, line: int, text: str) -> None:
        words = text.split()
        if not words or words[0] == "COMMENT":
            return
        if len(words) == 1 and words[0] in _MARKS:
            self._mark(line, words[0])
        elif self.place == _DATA:
            self._row(line, words)
        elif self.place != _COVARIANCE:
            self._keyword(line, text)

    def _mark(self, line: int, mark: str) -> None:
        if (self.place, mark) not in self.steps or not self.message.version:
            raise self.message.error(line, f"found {mark} in {self.place}, where it cannot stand")
        self.place = self.steps[self.place, mark]
        if mark == "META_START":
            self.segment = Segment(line)
            self.message.segments.append(self.segment)
        self.segment.covariances += mark == "COVARIANCE_START"

    def _row(self, line: int, words: list[str]) -> None:
        if "=" in words or words[0][:1].isalpha():
            raise self.message.error(
                line, f"found {show(' '.join(words))} among the data, wanted an epoch and numbers"
            )
        self.segment.epochs.append(words[0])
        self.segment.rows.append(words[1:])
        self.segment.lines.append(line)

    def _keyword(self, line: int, text: str) -> None:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not key:
            raise self.message.error(
                line, f"found {show(text.strip())} in {self.place}, wanted keyword = value"
            )
        if not self.message.version:
            self._first(line, key, value)
            return
        if self.place not in (_HEADER, _METADATA):
            raise self.message.error(line, f"found {cut(key)} in {self.place}, where it cannot stand")
        target = self.message.header if self.place == _HEADER else self.segment.meta
        if key == self.dialect.version_key:
            raise self.message.error(
                line, f"found {cut(key)} a second time, wanted it in the first line alone"
            )
        if key in target:
            raise self.message.error(
                line, f"found {cut(key)} a second time (first on line {target[key].line})"
            )
        if not value:
            raise self.message.error(line, f"found {cut(key)} without a value")
        target[key] = Entry(value, line)

    def _first(self, line: int, key: str, value: str) -> None:
        wanted = self.dialect.version_key
        if key != wanted:
            raise self.message.error(
                line, f"found {cut(key)}, wanted {wanted}: this is not a CCSDS {self.dialect.name}"
            )
        set_version(self.message, self.dialect, Entry(value, line))


def parse_kvn(path: str, text: str, dialect: Dialect) -> Message:
    """The message in ``text``; InputError for a line that does not belong where it stands, and for a text cut off."""
    parser = _Parser(path, dialect)
    # Not str.splitlines: it also breaks at form feeds and Unicode separators, and line numbers would drift.
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    for number, line in enumerate(lines, 1):
        parser.take(number, line)
    if not parser.message.version:
        raise InputError(f"{path}: found no {dialect.version_key}, wanted a CCSDS {dialect.name}")
    if parser.place in (_METADATA, _BEFORE_DATA, _COVARIANCE) or (
        dialect.data_marks and parser.place == _DATA
    ):
        raise parser.message.error(len(lines), f"the file breaks off in {parser.place}")
    return parser.message


def format_kvn(message: Message, dialect: Dialect) -> str:
    """The text of ``message``: columns as they are in ``rows``."""
    return "\n".join(_lines(message, dialect)) + "\n"


def _lines(message: Message, dialect: Dialect) -> Iterator[str]:
    yield f"{dialect.version_key} = {message.version}.0"
    yield from (f"{key} = {entry.text}" for key, entry in message.header.items())
    for segment in message.segments:
        yield from ("", "META_START")
        yield from (f"{key} = {entry.text}" for key, entry in segment.meta.items())
        yield from ("META_STOP", "")
        if dialect.data_marks:
            yield "DATA_START"
        for epoch, row in zip(segment.epochs, segment.rows, strict=True):
            yield f"{epoch} {' '.join(row)}"
        if dialect.data_marks:
            yield "DATA_STOP"
