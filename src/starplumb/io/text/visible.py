"""Names as a person may be shown them: a terminal or a page obeys some characters rather than showing them."""

from __future__ import annotations

import re

OBEYED = frozenset(
    {
        *set(range(0x20)) - set(b"\n\t"),
        *range(0x7F, 0xA0),
        *range(0x202A, 0x202F),
        *range(0x2066, 0x206A),
        *(0x2028, 0x2029, 0xFEFF),
    }
)
"""Commands of a terminal, and characters that turn the direction of writing."""
_SHOWN = {code: f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" for code in OBEYED}
IN_NAME = f"[{''.join(map(chr, sorted(OBEYED)))}]"
"""A regular expression for what no name in a table may hold: it would be obeyed wherever that name is written."""
_obeyed = re.compile(IN_NAME)


def visible(text: str) -> str:
    """``text`` with such characters as Python would write them."""
    return text.translate(_SHOWN) if _obeyed.search(text) else text
