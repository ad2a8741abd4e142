"""XML as a tree whose elements know their line; the one reader of all XML.

Parsed by expat directly, so that a DOCTYPE is refused at its first byte: entities declared there could expand without
end, and no file that is read here needs one. Prefixes of namespaces are taken off the names.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import cast
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from ...physics.errors import InputError

MOST_ELEMENTS = 3_000_000
"""Of a file that is read as a tree: each takes some 200 bytes."""


class XmlElement(Element):
    """An element and the ``line`` of the file on which it starts, counted from 1."""

    __slots__ = ("line",)
    line: int

    def elements(self) -> Iterator[XmlElement]:
        """This element and all below it, in the order of the file."""
        return cast("Iterator[XmlElement]", self.iter())


def parse_xml(name: str, data: bytes) -> XmlElement:
    """The root element of the file ``name``, in whatever encoding it declares.

    Raises InputError, with the line, for what is not well formed, has a DOCTYPE or cannot be decoded, and for more than
    :data:`MOST_ELEMENTS`.
    """
    if data.count(b"<") > 2 * MOST_ELEMENTS or data.count(b"=") > 2 * MOST_ELEMENTS:
        raise InputError(f"{name}: found more than {MOST_ELEMENTS:,} elements, wanted fewer")
    parser = expat.ParserCreate()
    builder = TreeBuilder(element_factory=XmlElement)
    make = cast("Callable[[str, dict[str, str]], XmlElement]", builder.start)
    local_name = cache(lambda tag: tag.rpartition(":")[2])

    def start(tag: str, attributes: dict[str, str]) -> None:
        make(local_name(tag), attributes).line = parser.CurrentLineNumber

    def doctype(*_: object) -> None:
        found = "found a DOCTYPE, wanted none (it is refused for safety)"
        raise InputError(f"{name}, line {parser.CurrentLineNumber}: {found}")

    parser.buffer_text = True
    parser.StartElementHandler = start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        reason = expat.errors.messages.get(error.code, "malformed")
        found = f"found XML that is not well formed ({reason})"
        raise InputError(f"{name}, line {error.lineno}: {found}, wanted well-formed XML") from None
    except (LookupError, ValueError) as error:
        raise InputError(
            f"{name}: found XML in an encoding that cannot be read ({error}), wanted UTF-8"
        ) from None
    return cast("XmlElement", builder.close())
