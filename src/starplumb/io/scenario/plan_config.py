"""The section [plan] of ``SCENARIO.toml`` as a checked model: what ``starplumb plan`` may choose from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from ..text.files import show
from ..text.sections import Section, wrong
from ..text.values import Positive, Text, number, vector
from .error_config import NotNegative

MOST_DAYS = 3653.0
"""Of a plan's span: ten years, of which nobody knows the orbit."""


def _numbers(wanted: str) -> BeforeValidator:
    """One number or a list of them, as a tuple."""

    def check(value: object) -> tuple[float, ...]:
        items = value if isinstance(value, list | tuple) else [value]
        if not items:
            raise wrong(value, wanted)
        return vector(len(items), wanted)(items)

    return BeforeValidator(check, json_schema_input_type=float | list[float])


Numbers = Annotated[tuple[float, ...], _numbers("one number or a list of numbers")]


class PlanConfig(Section):
    """[plan]: what ``starplumb plan`` may choose from; left out, as the defaults say."""

    start: Text | None = Field(default=None, description="when the plan begins (left out: scenario.epoch)")
    days: Annotated[
        float, BeforeValidator(number(f"days above 0, at most {MOST_DAYS:g}", lambda x: 0.0 < x <= MOST_DAYS))
    ] = Field(default=30.0, description="the span of the plan in days")
    sites: Text | None = Field(default=None, description="the name of a table of sites")
    max_look_deg: Annotated[
        float, BeforeValidator(number("degrees from 1 to 45", lambda x: 1.0 <= x <= 45.0))
    ] = Field(default=30.0, description="the largest angle off nadir, degrees")
    min_sun_deg: Annotated[
        float, BeforeValidator(number("degrees from -90 to 90", lambda x: abs(x) <= 90.0))
    ] = Field(default=10.0, description="the least height of the Sun, degrees")
    pitch_deg: Numbers = Field(
        default=(-20.0, -10.0, 0.0, 10.0, 20.0), description="the pitch angles to choose from, degrees"
    )
    yaw_deg: Numbers | None = Field(
        default=None, description="the turns about the boresight to choose from, degrees"
    )
    slew_deg_s: Positive = Field(default=2.0, description="the rate of a turn, degrees per second")
    settle_s: NotNegative = Field(default=5.0, description="the time a turn takes besides, s")
    per_pass: Annotated[int, Field(ge=1)] | None = Field(
        default=None, description="the most images of a pass, a whole number"
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        pitch = given.get("pitch_deg", ())
        for value in pitch if isinstance(pitch, list) else [pitch]:
            if isinstance(value, int | float) and abs(value) > 45.0:
                yield "pitch_deg", f"found {show(value)}, wanted degrees from -45 to 45"
