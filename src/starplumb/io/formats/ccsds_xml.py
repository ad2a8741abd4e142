"""CCSDS messages in XML: bytes to :class:`Message` and back."""

from __future__ import annotations

from collections.abc import Iterator
from xml.sax.saxutils import escape

from ...physics.errors import InputError
from ..text.files import cut, show
from ..text.xml_tree import XmlElement, parse_xml
from .ccsds_message import Dialect, Entry, Message, Segment, choice, set_version

_HEAD = '<?xml version="1.0" encoding="UTF-8"?>'
_SCHEMA = (
    'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
    'xsi:noNamespaceSchemaLocation="https://sanaregistry.org/r/ndmxml_unqualified/ndmxml-3.0.0-master-3.0.xsd"'
)


def read_xml(path: str, data: bytes, dialect: Dialect) -> Message:
    """The message in ``data``. Raises InputError where it is not well-formed XML, or no message of that kind."""
    body = _body(path, parse_xml(path, data), dialect)
    message = Message(path, named_columns=True)
    set_version(message, dialect, Entry(body.get("version", ""), body.line))
    for element in body.elements():
        _take(message, dialect, element)
    return message


def _body(path: str, root: XmlElement, dialect: Dialect) -> XmlElement:
    """The one element of the dialect: the root, or among the messages that an <ndm> combines."""
    name = dialect.name.lower()
    if root.tag not in (name, "ndm"):
        found = f"found the element {root.tag}, wanted {name}: this is not a CCSDS {dialect.name}"
        raise InputError(f"{path}, line {root.line}: {found}")
    bodies = [element for element in root.elements() if element.tag == name]
    if not bodies:
        raise InputError(f"{path}: found no element {name}, wanted a CCSDS {dialect.name}")
    if len(bodies) > 1:
        found = f"found a second {name}, wanted one message per file"
        raise InputError(f"{path}, line {bodies[1].line}: {found}")
    return bodies[0]


def _take(message: Message, dialect: Dialect, element: XmlElement) -> None:
    """Enter an element into the message, where it is one of those that hold its content."""
    if element.tag == "segment":
        message.segments.append(Segment(element.line))
    elif element.tag == "header":
        message.header = _entries(message, element)
    elif element.tag in ("metadata", "covarianceMatrix", dialect.record):
        if not message.segments:
            raise message.error(element.line, f"found {element.tag} outside a segment")
        segment = message.segments[-1]
        if element.tag == "metadata":
            segment.meta, segment.line = _entries(message, element), element.line
        elif element.tag == "covarianceMatrix":
            segment.covariances += 1
        else:
            _take_record(message, dialect, segment, element)


def _entries(message: Message, parent: XmlElement) -> dict[str, Entry]:
    """Values of the elements below ``parent`` that have none below them, each name once."""
    found: dict[str, Entry] = {}
    for leaf in parent.elements():
        if leaf is not parent and not len(leaf) and leaf.tag != "COMMENT":
            _enter(message, found, leaf)
    return found


def _enter(message: Message, found: dict[str, Entry], leaf: XmlElement) -> None:
    value = (leaf.text or "").strip()
    if leaf.tag in found:
        raise message.error(
            leaf.line, f"found {cut(leaf.tag)} a second time (first on line {found[leaf.tag].line})"
        )
    if not value:
        raise message.error(leaf.line, f"found {cut(leaf.tag)} without a value")
    found[leaf.tag] = Entry(value, leaf.line)


def _take_record(message: Message, dialect: Dialect, segment: Segment, record: XmlElement) -> None:
    """Epoch and columns of one row, whose units must be the standard's."""
    found: dict[str, Entry] = {}
    for leaf in record.elements():
        wanted = "" if leaf.tag == "EPOCH" else dialect.columns.get(leaf.tag)
        if wanted is None:
            continue
        if (unit := leaf.get("units")) and unit != wanted:
            raise message.error(
                leaf.line, f"{cut(leaf.tag)} is in {show(unit)}, wanted {wanted or 'no unit'}"
            )
        _enter(message, found, leaf)
    for name in ("EPOCH", *dialect.columns):
        if name not in found:
            for key, wanted_words in dialect.choices.items():  # a record of another type has other columns
                choice(message, segment, key, wanted_words)
            raise message.error(record.line, f"this {cut(record.tag)} has no {name}")
    segment.epochs.append(found["EPOCH"].text)
    segment.rows.append([found[name].text for name in dialect.columns])
    segment.lines.append(record.line)


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
