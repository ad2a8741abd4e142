"""A campaign read and checked, nothing solved: what is there, what is missing, and what to look at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..io.campaign.read import LoadedCampaign
from ..judge.files.overview import Rounding, Span, covered_images, misfits, rates, roundings, spans
from ..physics.errors import EpochError, InputError, counted
from ..physics.timescales import format_iso
from ..physics.units import DEG
from ..report.page import Table
from .arguments import checked
from .campaign import Campaign
from .show import Shown

Index = NDArray[np.int64]

FAR_DEG = 3.0
"""A model mounting that misses its marks by more is oftener a convention read otherwise than a mounting that is off."""
COARSE = 0.5
"""Rounding above this part of the stated sigma is worth a warning: it adds an eighth of it."""
MOST_NAMED = 5


@dataclass(frozen=True, repr=False, eq=False)
class Check(Shown):
    """What :func:`starplumb.check` returns; ``document`` is what --json prints."""

    campaign: Campaign
    document: dict[str, Any]

    @property
    def problems(self) -> Sequence[str]:
        """What makes the campaign unusable as it is."""
        return tuple(self.document["problems"])

    @property
    def warnings(self) -> Sequence[str]:
        """What to look at before the answer is believed."""
        return tuple(self.document["warnings"])

    def raise_if_unusable(self) -> None:
        """Raise InputError with the first problem."""
        if self.problems:
            raise InputError(self.problems[0])

    @property
    def tables(self) -> Sequence[Table]:
        d = self.document
        rows = [
            (
                s["file"],
                s["frame"],
                s["first"],
                s["last"],
                str(s["samples"]),
                "" if s["step_s"] is None else f"{s['step_s']:.4g}",
                str(len(s["gaps"])),
            )
            for s in d["series"]
        ]
        images = d["images"]
        rows.append(("images", "", images["first"], images["last"], str(images["count"]), "", ""))
        head = ("series", "frame", f"first ({d['time_scale']})", "last", "samples", "step, s", "gaps")
        found = [Table(f"{d['campaign']}: {d['camera']}", head, rows, text_columns=4)]
        digits = [
            (
                each["column"],
                f"{each['step']:.3g} {each['step_unit']}".strip(),
                f"{each['sigma']:.2g} {each['unit']}",
                f"{each['stated']:.3g} {each['unit']}",
            )
            for each in d["digits"]
        ]
        if digits:
            found.append(
                Table("Digits", ("column", "last digit", "its sigma", "stated sigma"), digits, text_columns=1)
            )
        return tuple(found)

    @property
    def answer(self) -> Sequence[str]:
        """Counts, and what follows from the model mounting."""
        d = self.document
        marks, images, sites, misfit = d["marks"], d["images"], d["landmarks"], d["model_misfit"]
        seen = f"{marks['control']} control and {marks['check']} check marks"
        if marks["detections"]:
            seen = counted(marks["detections"], "detection")
        sites_seen = f"{counted(sites['count'], 'landmark')} ({len(sites['not_seen'])} not seen)"
        each = f"{marks['fewest_in_an_image']} to {marks['most_in_an_image']} in an image"
        lines = [
            f"{counted(images['count'], 'image')}, {sites_seen}, {seen}, {each}",
            f"frames: {', '.join(f'{name} {frame}' for name, frame in d['frames'].items())}",
        ]
        if images["speed_m_s"] is not None:
            speed = f"{images['speed_m_s']:.0f} m/s relative to the turning Earth"
            lines.append(f"at the images: {speed}, turning by {images['rate_deg_s']:.3g} deg/s")
        if misfit["median_px"] is not None:
            away = f"{misfit['median_px']:.3g} px, {misfit['median_deg']:.3g} deg (median)"
            most = f"{misfit['largest_px']:.3g} px at most"
            lines.append(f"by the model mounting marks lie {away}, from their places, {most}")
        return tuple(lines)

    @property
    def verdict(self) -> str:
        """The last line."""
        if self.problems:
            return f"{counted(len(self.problems), 'problem')}: not usable as it is"
        return "usable" + (f"; {len(self.warnings)} to look at" if self.warnings else "")

    @property
    def told(self) -> Sequence[str]:
        """Counts, problems, what to look at and the verdict."""
        parts = (("problem", self.problems), ("look at", self.warnings))
        return (*self.answer, *(f"{word}: {text}" for word, texts in parts for text in texts), self.verdict)

    @property
    def sentences(self) -> Sequence[str]:
        return (*self.told, *(f"note: {notice}" for notice in self.document["notices"]))


@checked
def check(campaign: Campaign) -> Check:
    """Spans, gaps, rates, frames, counts and digits of a campaign, and who sees what; nothing is solved.

    What is read of a campaign is checked when it is read; ``problems`` are what only calibration would find, such as
    marks that attitude or orbit do not cover.
    """
    return Check(campaign, _document(campaign.loaded))


def _document(loaded: LoadedCampaign) -> dict[str, Any]:
    c, config, scale = loaded.campaign, loaded.config, loaded.config.campaign.time_scale
    marks = c.sightings if loaded.detections is None else loaded.detections
    inside, outside = covered_images(c), loaded.coverage.outside
    of_image = np.bincount(marks.image, minlength=len(c.images.ids))
    unseen = np.bincount(c.sightings.landmark, minlength=len(c.landmarks.ids)) == 0
    if loaded.detections is not None:
        unseen[:] = False
    digits = list(_digits(loaded))
    problems = _problems(loaded, inside)
    return {
        "schema": "starplumb-check/1",
        "campaign": c.name,
        "time_scale": scale,
        "camera": _camera(loaded),
        "frames": {
            "ephemeris": config.ephemeris.frame,
            **{key: f"{a.source} to {a.target}" for key, a in config.attitudes.items()},
            "mounting": f"{config.first[2].source} to {config.first[2].target}",
        },
        "series": [_series(span, scale) for span in spans(c)],
        "images": {
            "count": len(c.images.ids),
            **dict(zip(("first", "last"), _times(np.sort(c.images.t_ns)[[0, -1]], scale), strict=True)),
            "without_marks": _named(c.images.ids, of_image == 0),
            "not_covered": _named(c.images.ids, ~inside),
            **_rates(loaded),
        },
        "landmarks": {"count": len(c.landmarks.ids), "not_seen": _named(c.landmarks.ids, unseen)},
        "marks": {
            "control": int(np.sum(~c.sightings.check)),
            "check": int(np.sum(c.sightings.check)),
            "detections": 0 if loaded.detections is None else int(loaded.detections.image.size),
            "outside": int(outside.size),
            "fewest_in_an_image": int(of_image.min()),
            "most_in_an_image": int(of_image.max()),
        },
        "digits": [_rounding(each) for each in digits],
        "model_misfit": (misfit := _misfit(loaded)),
        "problems": problems,
        "warnings": list(_warnings(loaded, digits, misfit)),
        "notices": list(loaded.notices),
        "inputs": dict(loaded.inputs),
    }


def _problems(loaded: LoadedCampaign, inside: NDArray[np.bool_]) -> list[str]:
    """What calibration would refuse."""
    c, problems = loaded.campaign, []
    try:
        loaded.coverage.require()
    except InputError as error:
        problems.append(str(error))
    if not inside.any():
        problems.append(f"{c.images.name}: found no image at its time within attitude and orbit")
    return problems


def _warnings(loaded: LoadedCampaign, digits: Sequence[Rounding], misfit: dict[str, Any]) -> Any:
    for each in digits:
        if each.share > COARSE:
            step = f"{each.step:.3g} {each.unit}".strip()
            yield (
                f"{each.column}: the last digit is {step}, {each.sigma:.2g} {each.stated_unit} rms beside a stated "
                f"sigma of {each.stated:.3g} {each.stated_unit}; more digits, or a sigma that contains them"
            )
    usual = "a direction, frame, time or axis is read otherwise than meant; starplumb diagnose tries the usual ones"
    if misfit["behind_the_camera"]:
        marks = counted(misfit["behind_the_camera"], "mark")
        yield f"the model mounting puts {marks} behind the camera: perhaps {usual}"
    elif misfit["median_deg"] is not None and misfit["median_deg"] > FAR_DEG:
        yield (
            f"the model mounting misses its marks by {misfit['median_deg']:.3g} deg: unless it is that far off, {usual}"
        )


def _digits(loaded: LoadedCampaign) -> list[Rounding]:
    try:
        return list(roundings(loaded.campaign))
    except EpochError:  # an image in a table of Earth orientation's last days is said elsewhere
        return []


def _misfit(loaded: LoadedCampaign) -> dict[str, Any]:
    away, angle, behind = misfits(loaded.campaign)
    return {
        "median_px": float(np.median(away)) if away.size else None,
        "largest_px": float(np.max(away)) if away.size else None,
        "median_deg": float(np.median(angle)) / DEG if angle.size else None,
        "behind_the_camera": behind,
    }


def _rates(loaded: LoadedCampaign) -> dict[str, float | None]:
    speed, turn = rates(loaded.campaign)
    if not speed.size:
        return {"speed_m_s": None, "rate_deg_s": None}
    return {"speed_m_s": float(np.median(speed)), "rate_deg_s": float(np.median(turn)) / DEG}


def _camera(loaded: LoadedCampaign) -> str:
    columns, rows = loaded.campaign.camera.size_px
    kind = "line scanner" if loaded.campaign.camera.scans else "frame camera"
    size = f"{columns:.0f} x {rows:.0f} px" if np.isfinite(rows) else f"{columns:.0f} columns"
    return f"{kind}, {size}"


def _series(span: Span, scale: str) -> dict[str, Any]:
    first, last = _times(span.ends_ns, scale)
    return {
        "kind": span.kind,
        "file": span.name,
        "frame": span.frame,
        "samples": span.samples,
        "first": first,
        "last": last,
        "step_s": span.step_s,
        "gaps": [_times(gap, scale) for gap in span.gaps_ns],
    }


def _rounding(each: Rounding) -> dict[str, Any]:
    return {
        "column": each.column,
        "step": each.step,
        "step_unit": each.unit,
        "sigma": each.sigma,
        "stated": each.stated,
        "unit": each.stated_unit,
    }


def _times(t_ns: Index, scale: str) -> list[str]:
    return format_iso(t_ns, scale, 3)


def _named(ids: Sequence[str], chosen: NDArray[np.bool_]) -> list[str]:
    return [ids[i] for i in np.flatnonzero(chosen).tolist()]
