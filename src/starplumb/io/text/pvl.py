"""The text form of DigitalGlobe metadata (.IMD, .ATT, .EPH, .GEO): ``key = value;``, groups and lists, as a tree.

A list becomes what it is in the vendor's XML: ``attList = ( (..), (..) );`` an element ``attListList`` with one
element ``attList`` a row, so that both forms are read by the same code.
"""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from ...physics.errors import InputError
from .files import lines_of, read_text, show
from .tree import Node
from .xml_tree import MOST_ELEMENTS

_TOKEN = re.compile(
    r"""\s*+(?:
    (?P<group>BEGIN_GROUP|END_GROUP)\s*+=\s*+(?P<name>\w++)
  | (?P<end>END)\s*+;?\s*+\Z
  | (?P<key>\w++)\s*+=\s*+(?P<value>"[^"]*+"|\([^;]*\)|[^;"()]*+)\s*+;
    )""",
    re.VERBOSE,
)
"""Nothing that is matched is given back, so that a text which is none is refused in one go through it."""
_ROW = re.compile(r"\(([^()]*)\)")


def read_pvl(path: Path) -> Node:
    """The root of a text metadata file, named by the file's ending.

    Raises InputError naming the line where the text is not of that form, or that it ends before ``END;``.
    """
    text = read_text(path)
    if text.count("=") + text.count("(") > MOST_ELEMENTS:
        raise InputError(f"{path}: found more than {MOST_ELEMENTS:,} values, wanted the metadata of an image")
    root = Element(path.suffix[1:].upper() or "PVL")
    open_groups = [root]
    at = 0
    while True:
        match = _TOKEN.match(text, at)
        if match is None:
            raise _unsound(path, text, at)
        if match["end"]:
            break
        if match["group"] == "BEGIN_GROUP":
            open_groups.append(SubElement(open_groups[-1], match["name"]))
        elif match["group"]:
            if open_groups[-1].tag != match["name"] or len(open_groups) == 1:
                raise _unsound(path, text, match.start("group"))
            open_groups.pop()
        else:
            _add(open_groups[-1], match["key"], match["value"])
        at = match.end()
    if len(open_groups) > 1:
        raise InputError(f"{path}: found no END_GROUP = {open_groups[-1].tag}, wanted every group closed")
    return Node(path, root)


def _add(group: Element, key: str, value: str) -> None:
    if not value.startswith("("):
        SubElement(group, key).text = value.strip().strip('"')
        return
    rows = _ROW.findall(value[1:-1])
    rows_parent = SubElement(group, f"{key}List")
    for row in rows or [value[1:-1]]:
        SubElement(rows_parent, key).text = row.strip()


def _unsound(path: Path, text: str, at: int) -> InputError:
    """The error for the first text that is not a statement."""
    at += len(text[at:]) - len(text[at:].lstrip())
    if at >= len(text):
        return InputError(f"{path}: found its end without END;, wanted the whole file")
    line = text.count("\n", 0, at) + 1
    found = lines_of(text[at:])[0]
    return InputError(f"{path}, line {line}: found {show(found)}, wanted key = value; or a closed group")
