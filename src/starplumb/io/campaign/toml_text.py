"""Numbers and sections as the text of a TOML document."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import numpy as np

from ..tables.cells import Array

Sections = Sequence[tuple[str, Mapping[str, object]]]
"""Names of sections with their keys, in order; a name in brackets of its own is one of an array of tables."""


def document_text(sections: Sections, head: str = "") -> str:
    """A TOML document; every line of ``head`` stands at its top as a comment."""
    comments = "".join(f"# {line}\n" for line in head.splitlines())
    return comments + "\n".join(_section(name, keys) for name, keys in sections)


def in_unit(value: float | Array, unit: float) -> list[float] | float:
    """Numbers that, times ``unit``, give ``value`` again to the last bit where there are such, the shortest first."""
    if isinstance(value, np.ndarray):
        return [float(np.asarray(in_unit(float(x), unit))) for x in value]
    ratio = value / unit
    near = (
        float(f"{ratio:.12g}"),
        ratio,
        float(np.nextafter(ratio, np.inf)),
        float(np.nextafter(ratio, -np.inf)),
    )
    return next((x for x in near if x * unit == value), ratio)


_COMMENTS = {
    "quaternion_xyzw": "scalar last; takes camera coordinates to the star tracker's",
    "sigma_m": "one image's markers share it",
    "image_size_px": "columns, rows",
    "principal_point_px": "column, row; (0, 0) is the centre of the first pixel",
    "aberration": "false where the attitude contains it already",
}


def _section(name: str, keys: Mapping[str, object]) -> str:
    lines = [f"{key} = {_value(value)}" for key, value in keys.items()]
    notes = [f"  # {_COMMENTS[key]}" if key in _COMMENTS else "" for key in keys]
    return "\n".join([f"[{name}]", *(line + note for line, note in zip(lines, notes, strict=True))]) + "\n"


def _value(value: object) -> str:
    """A TOML value."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(float(value))
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_value(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple | np.ndarray):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return str(value)
