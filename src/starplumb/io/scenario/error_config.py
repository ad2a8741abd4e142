"""The error sources of ``SCENARIO.toml`` as checked models: trackers, [truth.NAME], [stated] and [initial]."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from ..tables.columns import SIGMA_PX
from ..text.files import show
from ..text.sections import Section, wrong
from ..text.values import OneOrThree, Positive, Quaternion, Sigma, Text, Triple, choice, number, one_or_three

NotNegative = Annotated[float, BeforeValidator(number("a number, not negative", lambda x: x >= 0.0))]
Correlation = Annotated[
    float, BeforeValidator(number("a number between -1 and 1, neither of the two", lambda x: -1.0 < x < 1.0))
]
Fraction = Annotated[float, BeforeValidator(number("a number between 0 and 1", lambda x: 0.0 <= x <= 1.0))]


def _harmonics(value: object) -> tuple[int, ...]:
    items = value if isinstance(value, list | tuple) else [value]
    whole = tuple(n for n in items if isinstance(n, int) and not isinstance(n, bool) and 1 <= n <= 20)
    if not items or len(whole) != len(items):
        raise wrong(value, "a whole number from 1 to 20, or a list of them")
    return whole


def fitting(
    section: type[Section],
    given: Mapping[str, Any],
    case: str,
    required: tuple[str, ...],
    optional: tuple[str, ...],
) -> Iterator[tuple[str, str]]:
    """Complaints about known keys that a case lacks, or that do not belong to it."""
    for key in required:
        if key not in given:
            yield key, f"missing, wanted {section.model_fields[key].description} (for {case})"
    for key in given:
        if key in section.model_fields and key not in (*required, *optional):
            yield key, f"found {show(given[key])}, wanted it left out for {case}"


class TrackerConfig(Section):
    """[[trackers]]: one star tracker; its axes in the frame of the attitude, E, and its noise about them."""

    name: Text = Field(description="the tracker's name in quotes")
    sigma_arcsec: Sigma = Field(description="its noise about its own axes, z along its boresight")
    quaternion_xyzw: Quaternion | None = Field(
        default=None, description="its axes in E: four numbers, scalar last"
    )
    rotation_vector_deg: Triple | None = Field(default=None, description="its axes in E: three numbers")
    boresight: Triple | None = Field(
        default=None, description="its boresight in E, where x and y do not matter"
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        ways = [key for key in ("quaternion_xyzw", "rotation_vector_deg", "boresight") if key in given]
        for key in ways[1:]:
            yield key, f"found beside {ways[0]}, wanted only one of the two"


_DISTRIBUTED = ("distribution", "degrees_of_freedom")
_KINDS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "attitude": (("sigma_arcsec",), ("shared_by", "tracker", "correlation_time_s", *_DISTRIBUTED)),
    "wander": (("sigma_arcsec", "correlation_time_s"), ("tracker", *_DISTRIBUTED)),
    "drift": (("sigma_arcsec",), ("harmonics", "tracker", *_DISTRIBUTED)),
    "position": (("sigma_m",), ("shared_by", "frame", "correlation_time_s", *_DISTRIBUTED)),
    "landmark": (("sigma_m",), ("shared_by", "correlation_length_m", *_DISTRIBUTED)),
    "pixel": (("sigma_px",), _DISTRIBUTED),
    "rounding": (("step_px",), ()),
    "blunder": (("rate", "size_px"), ()),
    "time-tag": (("sigma_ms",), ("shared_by", *_DISTRIBUTED)),
    "focal-length": (("sigma_ppm",), _DISTRIBUTED),
    "principal-point": (("sigma_px",), _DISTRIBUTED),
    "look-angles": (("sigma_px",), _DISTRIBUTED),
    "refraction": (("sigma_percent",), _DISTRIBUTED),
}
SHARED_BY = {
    "attitude": ("image", "pass", "session", "campaign"),
    "position": ("image", "pass", "session", "campaign"),
    "time-tag": ("campaign", "image", "pass", "session"),
    "landmark": ("marker", "campaign"),
}
"""Who shares one draw of an error; the first is meant where nothing is said."""


class ErrorConfig(Section):
    """[truth.NAME]: one source of error."""

    error: Annotated[str, choice(*_KINDS)] = Field(description=f"one of {', '.join(_KINDS)}")
    sigma_arcsec: Sigma | None = Field(default=None, description="one number of arcseconds or three")
    sigma_m: Sigma | None = Field(default=None, description="one number of metres or three")
    sigma_px: NotNegative | None = Field(default=None, description="a number of pixels per coordinate")
    sigma_column_px: Positive | None = Field(
        default=None, description="a positive number of pixels, of the column"
    )
    sigma_row_px: Positive | None = Field(default=None, description="a positive number of pixels, of the row")
    correlation: Correlation | None = Field(
        default=None, description="the correlation of column and row, between -1 and 1"
    )
    sigma_ms: NotNegative | None = Field(default=None, description="a number of milliseconds")
    sigma_ppm: NotNegative | None = Field(default=None, description="millionths of the focal length")
    sigma_percent: NotNegative | None = Field(default=None, description="a part of the refraction, percent")
    step_px: Positive | None = Field(
        default=None, description="the step to which coordinates are rounded, px"
    )
    rate: Fraction | None = Field(default=None, description="the probability of a blunder, 0 to 1")
    size_px: Positive | None = Field(default=None, description="the sigma of a blunder, px")
    shared_by: (
        Annotated[
            Literal["image", "pass", "session", "campaign", "marker"],
            choice("image", "pass", "session", "campaign", "marker"),
        ]
        | None
    ) = Field(
        default=None, description='who shares one draw: "image", "pass", "session", "campaign" or "marker"'
    )
    tracker: Text | None = Field(default=None, description="the name of one of the [[trackers]]")
    harmonics: Annotated[
        tuple[int, ...], BeforeValidator(_harmonics, json_schema_input_type=int | list[int])
    ] = Field(default=(1,), description="multiples of the argument of latitude, such as [1, 2]")
    frame: Annotated[Literal["ITRF", "GCRF", "orbital"], choice("ITRF", "GCRF", "orbital")] = Field(
        default="ITRF", description='"ITRF", "GCRF" or "orbital"'
    )
    correlation_time_s: Positive | None = Field(
        default=None,
        description="the correlation time of a Gauss-Markov error, s (its correlation then is 1/e)",
    )
    correlation_length_m: Positive | None = Field(
        default=None, description="the distance over which errors of neighbouring markers are alike, m"
    )
    distribution: Annotated[
        Literal["gaussian", "uniform", "student"], choice("gaussian", "uniform", "student")
    ] = Field(default="gaussian", description='"gaussian", "uniform" or "student"')
    degrees_of_freedom: Annotated[float, BeforeValidator(number("a number above 2", lambda x: x > 2.0))] = (
        Field(default=5.0, description="those of a Student distribution, above 2")
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        kind = given.get("error")
        if kind not in _KINDS:
            return
        required, optional = _KINDS[kind]
        if kind == "pixel" and any(key in given for key in SIGMA_PX):
            required = SIGMA_PX
        yield from fitting(cls, given, f'error = "{kind}"', required, (*optional, "error"))
        if "shared_by" in given and given["shared_by"] not in SHARED_BY.get(kind, (given["shared_by"],)):
            listed = " or ".join(f'"{word}"' for word in SHARED_BY[kind])
            yield "shared_by", f'found {show(given["shared_by"])}, wanted {listed} for error = "{kind}"'
        if "correlation_time_s" in given and given.get("shared_by", "image") != "image":
            yield "correlation_time_s", 'found it for an error that images share, wanted shared_by = "image"'
        if "correlation_length_m" in given and given.get("shared_by", "marker") != "marker":
            yield "correlation_length_m", 'found it for an error of the campaign, wanted shared_by = "marker"'
        if "degrees_of_freedom" in given and given.get("distribution") != "student":
            yield "degrees_of_freedom", 'found it for another distribution, wanted distribution = "student"'


class StatedConfig(Section):
    """[stated]: what the estimator believes, where it differs from the truth."""

    omit: list[str] = Field(
        default_factory=list, description="a list of names of sources that the estimator does not know of"
    )
    factor: dict[str, Annotated[float, BeforeValidator(number("a positive number", lambda x: x > 0.0))]] = (
        Field(default_factory=dict, description="stated sigma over true sigma, by the name of the source")
    )


class InitialConfig(Section):
    """[initial]: error of the model mounting from which every trial starts."""

    sigma_arcsec: Annotated[
        tuple[float, float, float],
        BeforeValidator(
            one_or_three("one number or three", lambda x: x >= 0.0), json_schema_input_type=OneOrThree
        ),
    ] = Field(default=(0.0, 0.0, 0.0), description="its sigma about E's axes, one number or three")
    distribution: Annotated[
        Literal["gaussian", "uniform", "student"], choice("gaussian", "uniform", "student")
    ] = Field(default="gaussian", description='"gaussian", "uniform" or "student"')
    stated: bool = Field(default=False, description="true where the estimator has the sigma as a prior")
