"""Keys of every section that names a table: what the table calls its columns, which rows count, how it writes times."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from ..text.sections import Section, wrong
from ..text.values import InMemory, Text, choice
from .declared import Declared, Times
from .read import TABLE_SUFFIXES
from .schema import SEPARATORS, Value

_FORMATS = ("iso", "unix", "unix_ms", "gps_seconds", "gps_week", "jd", "mjd", "doy")
_SCALES = ("UTC", "TAI", "GPS", "TT")


def _values(value: object) -> tuple[Value, ...]:
    items = value if isinstance(value, list | tuple) else [value]
    if not items or not all(isinstance(item, str | bool | int | float) for item in items):
        raise wrong(value, "a value or a list of values that a row must have to be used")
    return tuple(items)


def _two(value: object) -> tuple[str, str]:
    if (
        not isinstance(value, list | tuple)
        or len(value) != 2
        or not all(isinstance(name, str) for name in value)
    ):
        raise wrong(value, "the names of two columns, [week, seconds]")
    return value[0], value[1]


class TimeConfig(Section):
    """time: in which columns times stand, and how."""

    column: Text | None = Field(default=None, description="the name of the column of times")
    columns: Annotated[tuple[str, str], BeforeValidator(_two)] | None = Field(
        default=None, description="the names of two columns, [week, seconds]"
    )
    format: Annotated[
        Literal["iso", "unix", "unix_ms", "gps_seconds", "gps_week", "jd", "mjd", "doy"], choice(*_FORMATS)
    ] = Field(default="iso", description=f"one of {', '.join(_FORMATS)}")
    seconds_since: Text | None = Field(default=None, description='a time such as "2026-03-20T00:00:00"')
    scale: Annotated[Literal["UTC", "TAI", "GPS", "TT"], choice(*_SCALES)] | None = Field(
        default=None, description='the scale of these times, "UTC", "TAI", "GPS" or "TT"'
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        weeks = given.get("format") == "gps_week"
        if weeks and "columns" not in given:
            yield (
                "columns",
                'missing, wanted the names of two columns, [week, seconds], for format = "gps_week"',
            )
        if weeks and "column" in given:
            yield "column", 'found it with format = "gps_week", wanted columns = [week, seconds]'
        if "columns" in given and not weeks:
            yield "columns", 'found two columns, wanted them with format = "gps_week" only'
        if "seconds_since" in given and "format" in given:
            yield "format", "found beside seconds_since, wanted only one of the two"

    @property
    def times(self) -> Times:
        names = self.columns or (self.column or "time",)
        form = self.format if self.seconds_since is None else "seconds_since"
        return Times(names, form, self.scale, self.seconds_since)


class TableKeys(Section):
    """Keys of a section that names a table."""

    by_content: ClassVar[bool] = False
    """Whether the file may be of a standard format too, which its first lines tell when it is read."""

    columns: dict[str, Text] = Field(
        default_factory=dict, description='our names of columns with the table\'s, { time = "epoch" }'
    )
    keep: dict[
        str,
        Annotated[tuple[Value, ...], BeforeValidator(_values, json_schema_input_type=Value | list[Value])],
    ] = Field(default_factory=dict, description='values that a row must have to be used, { mode = "FINE" }')

    separator: Annotated[Literal[",", ";", "\t", "|"], choice(*SEPARATORS)] = Field(
        default=",", description='what stands between the cells of a text file, ",", ";", "\\t" or "|"'
    )
    decimal: Annotated[Literal[".", ","], choice(".", ",")] = Field(
        default=".", description='what stands before the decimals of a text file, "." or ","'
    )

    def declared(self, key: str) -> Declared:
        """What is declared of the table, for the section ``key``."""
        return Declared(
            key, self.columns, self.keep, self.times, separator=self.separator, decimal=self.decimal
        )

    @property
    def times(self) -> Times | None:
        return None

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        file = given.get("file", ".csv")
        names = [file] if isinstance(file, str) else file if isinstance(file, list | tuple) else []
        if not cls.by_content and any(
            isinstance(name, str)
            and not isinstance(name, InMemory)
            and not name.lower().endswith(TABLE_SUFFIXES)
            for name in names
        ):
            for key in ("columns", "keep", "time", "units", "separator", "decimal"):
                if key in given:
                    yield (
                        key,
                        "found beside a file that is no table (CSV, Parquet or Arrow), wanted it left out",
                    )


class TimedKeys(TableKeys):
    """Those of a table with times."""

    time: TimeConfig | None = Field(default=None, description="a section with column and format")

    @property
    def times(self) -> Times | None:
        return None if self.time is None else self.time.times


_LENGTHS = {"m": 1.0, "km": 1e3}
_SPEEDS = {"m/s": 1.0, "km/s": 1e3}


class UnitsConfig(Section):
    """ephemeris.units"""

    position: Annotated[Literal["m", "km"], choice("m", "km")] = Field(default="m", description='"m" or "km"')
    velocity: Annotated[Literal["m/s", "km/s"], choice("m/s", "km/s")] = Field(
        default="m/s", description='"m/s" or "km/s"'
    )

    @property
    def metres(self) -> float:
        return _LENGTHS[self.position]

    @property
    def metres_a_second(self) -> float:
        return _SPEEDS[self.velocity]
