"""[consider] of ``campaign.toml``: sigmas of what is not estimated."""

from __future__ import annotations

from pydantic import Field

from ..text.sections import Section
from ..text.values import Text

_PIXELS, _NUMBER = 'a sigma in pixels such as "0.4px"', 'a sigma, a number in quotes such as "0.01"'
_ANGLE, _TIME = 'a sigma at the ends of the line such as "0.4px" or "1arcsec"', 'a sigma such as "2ms"'


class ConsiderConfig(Section):
    """[consider]: each with its unit; a group stands for each of its members."""

    focal_length: Text | None = Field(default=None, description='a sigma such as "5um"')
    principal_point: Text | None = Field(default=None, description=_PIXELS)
    principal_column: Text | None = Field(default=None, description=_PIXELS)
    principal_row: Text | None = Field(default=None, description=_PIXELS)
    distortion: Text | None = Field(default=None, description=_NUMBER)
    k1: Text | None = Field(default=None, description=_NUMBER)
    k2: Text | None = Field(default=None, description=_NUMBER)
    k3: Text | None = Field(default=None, description=_NUMBER)
    p1: Text | None = Field(default=None, description=_NUMBER)
    p2: Text | None = Field(default=None, description=_NUMBER)
    look_angles: Text | None = Field(default=None, description=_ANGLE)
    look_x_1: Text | None = Field(default=None, description=_ANGLE)
    look_x_2: Text | None = Field(default=None, description=_ANGLE)
    look_x_3: Text | None = Field(default=None, description=_ANGLE)
    look_y_2: Text | None = Field(default=None, description=_ANGLE)
    look_y_3: Text | None = Field(default=None, description=_ANGLE)
    time_offset: Text | None = Field(default=None, description=_TIME)
    time_offset_attitude: Text | None = Field(default=None, description=_TIME)
    time_offset_orbit: Text | None = Field(default=None, description=_TIME)
    trackers: Text | None = Field(default=None, description='a sigma such as "5arcsec"')
    refraction: Text | None = Field(
        default=None, description='the part by which it may be wrong, such as "10%"'
    )

    @property
    def stated(self) -> dict[str, str]:
        """What is stated, by name."""
        return {name: text for name, text in self if text is not None}
