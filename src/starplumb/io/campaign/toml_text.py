"""Numbers and sections as the text of a TOML document."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..tables.cells import Array

if TYPE_CHECKING:
    from tomlkit.items import Table

Sections = Sequence[tuple[str, Mapping[str, object]]]
"""Names of sections with their keys, in order; a name in brackets of its own is one of an array of tables."""


def document_text(sections: Sections, head: str = "") -> str:
    """A TOML document; every line of ``head`` stands at its top as a comment."""
    import tomlkit

    document = tomlkit.document()
    for line in head.splitlines():
        document.add(tomlkit.comment(line))
    for name, keys in sections:
        array = name.removeprefix("[").removesuffix("]")
        if array == name:
            document.add(name, _section(keys, name))
        else:
            if array not in document:
                document.add(tomlkit.nl())
                document.add(array, tomlkit.aot())
            document[array].append(_section(keys, array))
    return tomlkit.dumps(document)


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
    "imagery.files": "one for each image of images.csv",
    "imagery.saturation_dn": "the value of a pixel that is full",
    "reference.sigma_m": "east and north of the orthoimage, up of the heights",
    "reference.correlation_length_m": "over which these errors are alike",
    "quaternion_xyzw": "scalar last; takes camera coordinates to the star tracker's",
    "ephemeris.sigma_m": "one image's markers share it",
    "image_size_px": "columns, rows",
    "principal_point_px": "column, row; (0, 0) is the centre of the first pixel",
    "aberration": "false where the attitude contains it already",
}


def _section(keys: Mapping[str, object], name: str) -> Table:
    import tomlkit

    section = tomlkit.table()
    for key, value in keys.items():
        item = tomlkit.item(_value(value))
        comment = _COMMENTS.get(f"{name}.{key}", _COMMENTS.get(key))
        if comment is not None:
            item.comment(comment)
        section.add(key, item)
    return section


def _value(value: object) -> object:
    """A value as TOML has it: floats with the digits that read back alike, arrays and tables in one line."""
    import tomlkit

    if isinstance(value, Mapping):
        table = tomlkit.inline_table()
        table.update({key: _value(item) for key, item in value.items()})
        return table
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    return list(value) if isinstance(value, tuple) else value
