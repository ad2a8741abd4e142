"""What to take next: which images, in which order, and how well the mounting is known after each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...io.scenario.candidates import Stage, home_site, stage
from ...io.scenario.plan_config import MOST_DAYS
from ...io.scenario.site_table import read_site_table
from ...physics import so3
from ...physics.errors import ArgumentError, EpochError, InputError
from ...physics.timescales import format_iso, moment
from ...physics.units import ARCSEC, DEG
from ...plan.choice.views import Sites
from ...report.page import Table
from ...report.text import counted
from ..arguments import Folder, Positive, Wanted, checked
from ..frames import Frame
from ..motion.prediction import predict
from ..result import Result
from ..scenario import Scenario
from ..show import Shown
from .choice import Asked, choose
from .document import INITIAL, SCHEMA, WORTH_SAYING, document

Array = NDArray[np.float64]
Images = Annotated[int, Wanted("a whole number from 1 to 1000", lambda value: 1 <= value <= 1000)]
Days = Annotated[
    float, Wanted(f"days above 0, at most {MOST_DAYS:g}", lambda value: 0.0 < value <= MOST_DAYS)
]

MARK = ("plan.json", SCHEMA)
PLAN_FILES = (MARK[0], "plan.csv", "plan.html")
SAME_SITE_M = 5e3
"""A place of the table so near to the scenario's own site is that."""
SAME_MOUNTING = 5.0 * DEG
"""A mounting that is given may be so far from the scenario's; one farther away is of another camera."""
SHOWN = 12
"""Images in the printed table; ``plan.csv`` and ``--json`` have all."""


@dataclass(frozen=True, repr=False, eq=False)
class Plan(Shown):
    """Which images to take: what :func:`starplumb.plan_images` returns.  ``document`` is ``plan.json``."""

    made_by: ClassVar[str] = "plan_images"

    document: dict[str, Any]

    @property
    def frame(self) -> Frame:
        """A row an image, the one that is worth most first."""
        return _frame(self.document["images"])

    def to_frame(self) -> Any:
        """A row an image, as a pandas data frame."""
        return self.frame.to_frame()

    @checked
    def save(self, folder: Folder) -> None:
        """Write ``plan.json``, ``plan.csv`` and ``plan.html``."""
        from ...io.text.write import csv_text, marked, publish
        from ...report.plan import plan_page

        frame = self.frame
        files = {"plan.csv": csv_text(frame.names, frame.columns), "plan.html": plan_page(self.document)}
        publish(Path(folder), files, mark=marked(MARK[0], self.document))

    @property
    def tables(self) -> Sequence[Table]:
        d = self.document
        kinds = [(k["kind"], str(k["images"]), f"{k['rms_m']:.3g}") for k in d["kinds"]]
        rows = [
            (
                str(i["order"]),
                i["time"][:19],
                i["site"],
                f"{i['pitch_deg']:.0f} {i['roll_deg']:.0f} {i['yaw_deg']:.0f}",
                "  ".join(f"{s:.3g}" for s in i["sigma_arcsec"]),
                f"{i['rms_m']:.3g}",
                "" if i["gain_m"] is None else f"{i['gain_m']:.2g}",
                "" if i["detectable_arcsec"] is None else f"{i['detectable_arcsec']:.3g}",
            )
            for i in d["images"][:SHOWN]
        ]
        head = (
            "",
            "time (UTC)",
            "site",
            "pitch roll yaw",
            "sigma x y z",
            "ground, m",
            "gain, m",
            "motion seen",
        )
        return (
            Table("What some more images of a kind leave on the ground", ("kind", "images", "m"), kinds),
            Table("Images, the one that is worth most first; deg, arcsec, m", head, rows, text_columns=3),
        )

    @property
    def sentences(self) -> Sequence[str]:
        from ...report.plan import of_cameras

        d = self.document
        left = len(d["images"]) - SHOWN
        lines = [
            *([f"and {left} more image{'s' * (left != 1)} (plan.csv)"] if left > 0 else []),
            *d["in_words"],
        ]
        bound, usual, rms = d["bound"], d["usual"], d["images"][-1]["rms_m"]
        lines.append(
            f"{len(d['images'])} of {counted(d['candidates']['views'], 'view')} in "
            f"{counted(d['candidates']['passes'], 'pass', 'passes')} leave{'s' * (len(d['images']) == 1)} "
            f"{rms:.3g} m; no choice of as many can leave less than {bound['rms_m']:.3g} m "
            f"(this one is within {max(bound['within_percent'], 0.1):.2g} %)"
        )
        ties = d["tie_points"]
        if ties is not None and rms > WORTH_SAYING * ties["rms_m"]:
            lines.append(
                f"with {ties['each']} tie points at each site the same images leave {ties['rms_m']:.3g} m"
            )
        if usual["rms_m"] is not None:
            lines.append(
                f"{counted(usual['images'], 'view')} of the usual kind would leave {usual['rms_m']:.3g} m"
            )
        lines += of_cameras(d)
        if d["target"] is not None:
            lines.append(d["target"]["in_words"])
        return lines

    @property
    def notices(self) -> Sequence[str]:
        """What should be known of it."""
        return tuple(self.document["notices"])


def _frame(images: Sequence[dict[str, Any]]) -> Frame:
    single = [key for key in images[0] if key != "sigma_arcsec"]
    columns = [["" if image[key] is None else image[key] for image in images] for key in single]
    sigmas = [[image["sigma_arcsec"][k] for image in images] for k in range(3)]
    return Frame("Plan", (*single, *(f"sigma_{a}_arcsec" for a in "xyz")), (*columns, *sigmas))


@checked
def plan_images(
    scenario: Scenario,
    images: Images = 20,
    target_arcsec: Positive | None = None,
    given: Result | str | Path | None = None,
    sites: str | Path | None = None,
    start: str | None = None,
    days: Days | None = None,
    satellite: str | None = None,
    camera: str | None = None,
) -> Plan:
    """Say which images to take, in which order, and how well the mounting is known after each.

    Views are those of the scenario's orbit over its site and those of the table ``sites``, from ``start`` (UTC; left
    out: the scenario's) over ``days``, as its section [plan] says.  At most ``images``, fewer where ``target_arcsec``,
    the wanted sigma about each axis, is reached before.  ``given`` is what is known already: a Result, the path of a
    ``result.json`` or of an archive, with the covariance that ``predict`` states for the start, of ``satellite``
    and ``camera`` where it has several.  Raises InputError where no view is possible, and where the given mounting is
    more than 5 deg from the scenario's.
    """
    read = scenario.read
    notices: list[str] = []
    with read.named():
        flown = stage(read.config, read.folder)
    all_sites = _sites(flown, None if sites is None else Path(sites), read.name, notices)
    first = _start_ns(flown, start)
    start_s = 1e-9 * (first - flown.epoch_ns)
    end_s = start_s + 86400.0 * (days or read.config.plan.days)
    known, name = _known(given, flown, first, (satellite, camera), notices)
    if known is None and scenario.data.prior_E is not None:
        known = scenario.data.prior_E
        name = INITIAL
    with read.named():
        sigma = 0.0 if target_arcsec is None else target_arcsec * ARCSEC
        found = choose(flown, all_sites, Asked(images, sigma, start_s, end_s, known))
    return Plan(document(found, name, notices))


def _start_ns(flown: Stage, start: str | None) -> int:
    text = start or flown.config.plan.start
    if text is None:
        return flown.epoch_ns
    try:
        return moment(text, "UTC")
    except EpochError as error:
        raise ArgumentError("start", str(error)) from None


def _known(
    given: Result | str | Path | None,
    flown: Stage,
    at_ns: int,
    of: tuple[str | None, str | None],
    notices: list[str],
) -> tuple[Array | None, str | None]:
    """Covariance (3, 3) rad^2 of what is given, at the start of the plan.  Raises InputError where that is the mounting
    of another camera: its axes would be others."""
    if given is None:
        return None, None
    found = predict(given, format_iso([at_ns], "UTC")[0], satellite=of[0], camera=of[1])
    name = "the result" if isinstance(given, Result) else str(given)
    away = float(np.linalg.norm(so3.log(found.C_EK @ flown.C_EK.T)))
    if away > SAME_MOUNTING:
        raise InputError(
            f"{name}: found a mounting {away / DEG:.3g} deg from the scenario's ([mounting]), wanted one of the same "
            f"camera, at most {SAME_MOUNTING / DEG:g} deg from it"
        )
    if found.covariance_arcsec2 is None:
        raise InputError(
            f"{name}: covariance_arcsec2: found null, wanted a result that states it, such as that of gls"
        )
    notices += [
        *found.notices,
        f"{name}: its landmarks, passes and sessions are taken for others than those of the plan",
    ]
    return found.covariance_arcsec2 * ARCSEC**2, name


def _sites(flown: Stage, path: Path | None, scenario: Path, notices: list[str]) -> Sites:
    """The scenario's own site first, then those of the table."""
    home, named = home_site(flown.config), flown.config.plan.sites
    if path is None and named is not None:
        path = flown.folder / named
    table = None if path is None else read_site_table(path, notices)
    if home is None and table is None:
        raise InputError(
            f"{scenario}: found neither [site] nor a table of sites (--sites), wanted places with markers to look at"
        )
    if table is None:
        assert home is not None
        return home
    if home is None:
        return table
    own = np.linalg.norm(table.r_J - home.r_J, axis=-1) < SAME_SITE_M
    order = np.concatenate([np.flatnonzero(own), np.flatnonzero(~own)])
    if np.any(own):
        return table.only(order)
    return home.and_(table)
