"""A campaign in a session: from its file, from tables, or the example."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ..io.campaign.marks.outside import Outside
from ..io.campaign.read import LoadedCampaign, load_campaign
from ..physics.errors import InputError
from ..physics.series import Attitude
from ..report.text import counted
from ..table.campaign import Campaign as Physics
from .arguments import Seed, Wanted, checked
from .show import Shown

Array = NDArray[np.float64]
Settings = Annotated[
    Mapping[str, Any] | str | Path, Wanted("the path of campaign.toml or its keys as a dictionary")
]


DemoImages = Annotated[int, Wanted("a whole number from 1 to 40", lambda value: 1 <= value <= 40)]


@dataclass(frozen=True, repr=False, eq=False)
class Campaign(Shown):
    """A campaign that was read and checked; ``source`` is what messages call it.

    ``loaded`` holds the physics and what it was read from; ``path`` is that of its ``campaign.toml``, None where its
    settings are from no file.
    """

    made_by: ClassVar[str] = "read_campaign"

    loaded: LoadedCampaign
    source: str
    path: Path | None = None
    camera: str | None = None
    """Of several cameras the one that it is the campaign of; None for all of them, or the only one."""

    @classmethod
    @checked
    def read(cls, path: str | Path, outside: Outside = "refuse") -> Campaign:
        """The campaign of a ``campaign.toml`` and the files that it names.

        ``outside="skip"`` leaves out marks that attitude or orbit do not cover, and says which; else they are refused
        where they are needed.  Raises InputError, one sentence, for the first file that cannot be used.
        """
        return cls(load_campaign(Path(path), with_detections=True, outside=outside), str(path), Path(path))

    @classmethod
    @checked
    def from_tables(cls, settings: Settings, *, outside: Outside = "refuse", **tables: object) -> Campaign:
        """A campaign of settings and tables, with the same checks and sentences as one of files.

        ``settings`` are the keys of ``campaign.toml`` as a dictionary, or its path.  ``tables`` are paths or data
        frames (pandas, polars, PyArrow and any other that gives Arrow data, or a mapping of columns), by the name of
        their section: ``attitude``, ``ephemeris``, ``landmarks``, ``images``, ``observations`` or ``detections``.
        ``outside`` is as in :meth:`read`.

        Raises InputError, one sentence, for the first table that cannot be used.
        """
        settings = Path(settings) if isinstance(settings, str) else settings
        loaded = load_campaign(settings, tables, with_detections=True, outside=outside)
        path = settings if isinstance(settings, Path) else None
        return cls(loaded, loaded.campaign.name if path is None else str(path), path)

    @property
    def name(self) -> str:
        return self.loaded.campaign.name

    @property
    def C_EK(self) -> Array:
        """The model mounting (3, 3), from the camera to the star tracker, that is to be corrected."""
        return self.loaded.campaign.C_EK

    @property
    def C_EK_true(self) -> Array | None:
        """The true mounting (3, 3) of a simulated campaign that states it, else None."""
        return self.loaded.C_EK_true

    @property
    def images(self) -> tuple[str, ...]:
        """The ids of the images."""
        return self.loaded.campaign.images.ids

    @property
    def landmarks(self) -> tuple[str, ...]:
        """The ids of the landmarks."""
        return self.loaded.campaign.landmarks.ids

    @property
    def notices(self) -> tuple[str, ...]:
        """What was left out when it was read, or looks odd."""
        return self.loaded.notices

    @property
    def frames(self) -> tuple[str, str]:
        """The names of the camera's and the star tracker's frame; of several cameras those of the first."""
        return self.camera or self.loaded.config.first[0], self.loaded.config.tracker

    @checked
    def require_one_camera(self, what: str) -> None:
        """Raise InputError where the campaign has several cameras and ``what`` works with one."""
        if self.loaded.campaign.several:
            names = ", ".join(self.loaded.config.optics)
            raise InputError(
                f"{self.source}: cameras: found {names}, wanted one camera: {what} works with one"
            )

    def require_observations(self) -> None:
        """Raise InputError where the campaign has detections whose landmarks are not known, or marks without attitude
        or orbit."""
        if self.loaded.detections is not None:
            raise InputError(
                f"{self.source}: detections: found marker images whose landmarks are not known, wanted [observations]: "
                "label the detections first"
            )
        self.loaded.coverage.require()

    @property
    def sentences(self) -> Sequence[str]:
        campaign, detections = self.loaded.campaign, self.loaded.detections
        checks = int(np.sum(campaign.sightings.check))
        seen = f"{campaign.sightings.image.size - checks} control and {checks} check observations"
        if detections is not None:
            seen = f"{counted(detections.image.size, 'detection')} whose landmarks are not known"
        camera = "line scanner" if campaign.camera.scans else "frame camera"
        return (
            f"Campaign {self.name!r}: {camera}, {counted(len(self.images), 'image')}, "
            f"{counted(len(self.landmarks), 'landmark')}, {seen}",
            *(f"note: {notice}" for notice in self.notices),
        )


@checked
def read_campaign(path: str | Path, outside: Outside = "refuse") -> Campaign:
    """The campaign of a ``campaign.toml``; as :meth:`Campaign.read`."""
    return Campaign.read(path, outside)


@checked
def demo(camera: Literal["frame", "line-scan"] = "frame", images: DemoImages = 8, seed: Seed = 1) -> Campaign:
    """The example of ``starplumb init``: simulated data whose true mounting is known."""
    from tempfile import TemporaryDirectory

    from .beginning import schema_text

    with TemporaryDirectory(prefix="starplumb-") as folder:
        path, _ = write_demo(Path(folder), camera, images, seed, schema_text("campaign"))
        loaded = load_campaign(path)
    return Campaign(_without_folder(loaded), "demo")


def _without_folder(loaded: LoadedCampaign) -> LoadedCampaign:
    """A campaign whose files are gone, by their bare names."""
    c = loaded.campaign
    assert isinstance(c.attitude, Attitude)  # one tracker
    data = replace(
        c,
        ephemeris=replace(c.ephemeris, name=Path(c.ephemeris.name).name),
        attitude=replace(c.attitude, name=Path(c.attitude.name).name),
        images=replace(c.images, name=Path(c.images.name).name),
    )
    rows = replace(loaded.rows, source=Path(str(loaded.rows.source)).name)
    return replace(loaded, campaign=data, rows=rows, sources=())


def write_demo(
    folder: Path,
    camera: Literal["frame", "line-scan"] = "frame",
    images: int = 8,
    seed: int = 1,
    schema: str = "",
) -> tuple[Path, Physics]:
    """Write the example into a folder, with a JSON schema if given; the path of its ``campaign.toml``, and what it
    holds."""
    from ..io.campaign.write import write_campaign
    from ..plan.demo import demo as simulated

    campaign, C_EK_true = simulated(camera, images, seed)
    write_campaign(folder, campaign, C_EK_true=C_EK_true, schema=schema)
    return folder / "campaign.toml", campaign
