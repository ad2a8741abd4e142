"""CCSDS messages in XML: bytes to :class:`Message` and back.

Parsed by expat directly, which knows the line of every element. Documents with a DOCTYPE are refused at its
first byte: navigation messages have none, and entities declared there could expand without end.
"""

from __future__ import annotations

from collections.abc import Iterator
from xml.parsers import expat
from xml.sax.saxutils import escape

from ...physics.errors import InputError
from .ccsds_message import Dialect, Entry, Message, Segment, set_version

_HEAD = '<?xml version="1.0" encoding="UTF-8"?>'
_SCHEMA = (
    'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
    'xsi:noNamespaceSchemaLocation="https://sanaregistry.org/r/ndmxml_unqualified/ndmxml-3.0.0-master-3.0.xsd"'
)
_BRANCHES = ("header", "metadata")
_SKIPPED = ("covarianceMatrix",)


class _Builder:
    """expat's handlers. ``branch`` is the element whose leaves are being collected into ``leaves``."""

    def __init__(self, path: str, dialect: Dialect) -> None:
        self.message = Message(path, named_columns=True)
        self.dialect = dialect
        self.parser = expat.ParserCreate(namespace_separator="}")
        self.parser.buffer_text = True
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._characters
        self.wanted = {"EPOCH": "", **dialect.columns}
        self.branches = {*_BRANCHES, *_SKIPPED, dialect.record}
        self.root = dialect.name.lower()
        self.found_root = False
        self.combined = False  # an <ndm> holds several messages; ours is looked for among them
        self.inside = False
        self.branch = ""
        self.branch_line = 0
        self.leaves: dict[str, Entry] = {}
        self.leaf = ""
        self.leaf_line = 0
        self.text: list[str] = []

    def _error(self, text: str) -> InputError:
        return self.message.error(self.parser.CurrentLineNumber, text)

    def _doctype(self, *_: object) -> None:
        raise self._error("found a DOCTYPE, a navigation message has none and it is refused for safety")

    def _characters(self, text: str) -> None:
        self.text.append(text)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        name = tag.rpartition("}")[2]
        self.text.clear()
        self.leaf, self.leaf_line = name, self.parser.CurrentLineNumber
        if self.branch == self.dialect.record:
            if (unit := attributes.get("units")) and name in self.wanted and unit != self.wanted[name]:
                raise self._error(f"{name} is in {unit!r}, {self.wanted[name] or 'no unit'} is wanted")
        elif not self.branch:
            self._structure(name, attributes)

    def _structure(self, name: str, attributes: dict[str, str]) -> None:
        if not self.inside:
            self._enter(name, attributes)
        elif name == "segment":
            self.message.segments.append(Segment(self.parser.CurrentLineNumber))
        elif name in self.branches:
            if name != "header" and not self.message.segments:
                raise self._error(f"found {name} outside a segment")
            self.branch, self.branch_line = name, self.parser.CurrentLineNumber
            self.leaves = {}
            if name == "covarianceMatrix":
                self.message.segments[-1].covariances += 1

    def _enter(self, name: str, attributes: dict[str, str]) -> None:
        if name == self.root:
            if self.found_root:
                raise self._error(f"found a second {name}, one message per file is wanted")
            self.found_root = self.inside = True
            set_version(
                self.message,
                self.dialect,
                Entry(attributes.get("version", ""), self.parser.CurrentLineNumber),
            )
        elif name == "ndm":
            self.combined = True
        elif not self.combined:
            raise self._error(
                f"found the element {name}, wanted {self.root}: this is not a CCSDS {self.dialect.name}"
            )

    def _end(self, tag: str) -> None:
        name = tag.rpartition("}")[2]
        if self.branch and name == self.branch:
            self._close()
            self.branch = ""
        elif self.branch and name == self.leaf:
            self._take(name)
        elif name == self.root:
            self.inside = False
        self.leaf = ""
        self.text.clear()

    def _take(self, name: str) -> None:
        if name == "COMMENT" or (self.branch == self.dialect.record and name not in self.wanted):
            return
        value = "".join(self.text).strip()
        if name in self.leaves:
            raise self._error(f"found {name} a second time (first on line {self.leaves[name].line})")
        if not value:
            raise self._error(f"found {name} without a value")
        self.leaves[name] = Entry(value, self.leaf_line)

    def _close(self) -> None:
        if self.branch == "header":
            self.message.header = self.leaves
        elif self.branch == "metadata":
            self.message.segments[-1].meta = self.leaves
            self.message.segments[-1].line = self.branch_line
        elif self.branch == self.dialect.record:
            segment = self.message.segments[-1]
            missing = [name for name in self.wanted if name not in self.leaves]
            if missing:
                raise self.message.error(self.branch_line, f"this {self.branch} has no {missing[0]}")
            segment.epochs.append(self.leaves["EPOCH"].text)
            segment.rows.append([self.leaves[name].text for name in self.dialect.columns])
            segment.lines.append(self.branch_line)


def parse_xml(path: str, data: bytes, dialect: Dialect) -> Message:
    """The message in ``data``, in whatever encoding it declares; InputError where it is not sound XML."""
    builder = _Builder(path, dialect)
    try:
        builder.parser.Parse(data, True)
    except expat.ExpatError as error:
        reason = expat.errors.messages.get(error.code, "malformed")
        raise InputError(f"{path}, line {error.lineno}: is not sound XML ({reason})") from None
    except (LookupError, ValueError) as error:
        raise InputError(f"{path}: its XML declares an encoding that cannot be read ({error})") from None
    if not builder.found_root:
        raise InputError(f"{path}: found no element {builder.root}, wanted a CCSDS {dialect.name}")
    return builder.message


def format_xml(message: Message, dialect: Dialect) -> str:
    """The text of ``message`` as XML: columns as they are in ``rows``."""
    return "\n".join(_lines(message, dialect)) + "\n"


def _lines(message: Message, dialect: Dialect) -> Iterator[str]:
    root = dialect.name.lower()
    yield _HEAD
    yield f'<{root} {_SCHEMA} id="{dialect.version_key}" version="{message.version}.0">'
    yield "<header>"
    yield from _leaves(message.header)
    yield "</header>\n<body>"
    for segment in message.segments:
        yield "<segment>\n<metadata>"
        yield from _leaves(segment.meta)
        yield "</metadata>\n<data>"
        for epoch, row in zip(segment.epochs, segment.rows, strict=True):
            yield dialect.record_template.format(epoch, *row)
        yield "</data>\n</segment>"
    yield f"</body>\n</{root}>"


def _leaves(entries: dict[str, Entry]) -> Iterator[str]:
    return (f"<{key}>{escape(entry.text)}</{key}>" for key, entry in entries.items())
