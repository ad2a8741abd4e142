"""The joint solution of an archive's campaigns: what ``show`` says."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...documents.numbers import numbers
from ...io.archive.equations import equations
from ...io.archive.rows import Entry, Instrument, entries, inputs_of, moments_again, result_text
from ...judge.trust import IMPLAUSIBLE_P, NORMAL_95
from ...mission.joint import MOUNTING, Equations, Joint, joint, shared_names
from ...mission.points import Points, points, scatter
from ...physics import so3
from ...physics.errors import InputError, counted
from ...physics.timescales import format_iso
from ...physics.units import ARCSEC
from ...report.page import Table
from ..show import Shown
from .entries import why_not

Array = NDArray[np.float64]

FAR_ARCSEC = 60.0
"""A campaign whose equations are about a mounting farther from the joint one is not linear enough any more."""
SAME = 1e-6
"""Part by which what is known of the mounting beforehand may differ and be the same."""


@dataclass(frozen=True)
class Standing:
    """The campaigns that count, with their equations: of an instrument's camera, and of others that are linked with it
    by a campaign of both."""

    entries: tuple[Entry, ...]
    parts: tuple[Equations, ...]
    left_out: tuple[tuple[Entry, str], ...]
    mounting_known: bool
    notices: tuple[str, ...]

    @property
    def own(self) -> tuple[list[Entry], list[Equations]]:
        """Those of the camera itself."""
        pairs = [pair for pair in zip(self.entries, self.parts, strict=True) if MOUNTING in pair[1].blocks]
        return [entry for entry, _ in pairs], [part for _, part in pairs]


def standing(name: str, database: sqlite3.Connection, instrument: Instrument) -> Standing:
    """Those of an instrument.  Raises InputError where none counts."""
    mine = entries(database, instrument)
    left = tuple((entry, reason) for entry in mine if (reason := why_not(entry)) is not None)
    used = tuple(entry for entry in mine if why_not(entry) is None)
    if not any(instrument.frame_from in entry.cameras for entry in used):
        reasons = "; ".join(f"{entry.name}: {reason}" for entry, reason in left[:3])
        raise InputError(
            f"{name}: found no campaign of {instrument} that counts ({reasons}), wanted one or more"
        )
    parts = tuple(equations(database, used, instrument.frame_from))
    gone = [entry for entry in mine if entry.withdrawn is not None]
    agreed, notices = _known_before(database, parts, used, gone)
    again = _again(moments_again(database, used))
    return Standing(used, parts, left, agreed, (*notices, *_near_ground(parts), *again))


def _again(moments: int) -> tuple[str, ...]:
    """Errors of attitude and orbit at a moment are in the equations of one campaign only."""
    if not moments:
        return ()
    return (
        f"{counted(moments, 'moment')} at which images were taken occur{'s' * (moments == 1)} in several "
        "campaigns: their errors of attitude and orbit count as independent, and the sigmas are too small; wanted one "
        "campaign of all images of a moment",
    )


def _near_ground(parts: Sequence[Equations]) -> tuple[str, ...]:
    """Errors that neighbours on the ground share are in the equations of one campaign only."""
    some = sum(any(name.startswith("shared[neighbours") for name in part.blocks) for part in parts)
    if some < 2:
        return ()
    return (
        f"{some} campaigns have landmarks whose errors neighbours share (landmarks.correlation_length_m); between "
        "campaigns they count as independent: where they are of the same ground, the sigmas are too small, and one "
        "campaign of all these images has the right ones",
    )


def _known_before(
    database: sqlite3.Connection, parts: Sequence[Equations], found: Sequence[Entry], gone: Sequence[Entry]
) -> tuple[bool, tuple[str, ...]]:
    """Whether what campaigns state of the mounting beforehand may be added: all the same, and of no campaign here, nor
    of one that is withdrawn, whose data would count on."""
    of_each = [_stated(part) for part in parts]
    stated = [known for known in of_each if known is not None]
    if not stated:
        return True, ()
    first, C_first = stated[0]
    one = all(np.allclose(P, first, rtol=SAME) and np.allclose(C, C_first, atol=1e-9) for P, C in stated)
    by = [entry for entry, known in zip(found, of_each, strict=True) if known is not None]

    def told(some: Sequence[Entry]) -> bool:
        # a result that is a prior is known by its mounting: its covariance may have grown since
        alike = any(np.allclose(C, entry.C_EK, rtol=0.0, atol=1e-9) for _, C in stated for entry in some)
        return alike or given_of_these(database, by, some)

    if told(found):
        why = "is that of another campaign here"
    elif told(gone):
        why = "is that of a campaign that is withdrawn"
    elif one:
        return True, ()
    else:
        why = "is not the same in all that state it"
    return False, (f"what campaigns state of the mounting beforehand is left out: it {why}",)


def given_of_these(database: sqlite3.Connection, by: Sequence[Entry], found: Sequence[Entry]) -> bool:
    """Whether a file that one of some campaigns was made from is the result of another: a mounting that moves is known
    elsewhere at a later date, and only its file tells it."""
    given = {digest for entry in by for digest in inputs_of(database, entry.id).values()}
    return any(_digest_of(result_text(database, entry.id)) in given for entry in found)


def _digest_of(text: str) -> str:
    return f"sha256:{sha256(text.encode()).hexdigest()}"


def _stated(part: Equations) -> tuple[Array, Array] | None:
    """The covariance and the mounting that a campaign states of its first camera beforehand; None for nothing."""
    if part.together is not None:
        name, expected, P = (
            part.together.names[0],
            part.together.expected[:3],
            part.together.covariance[:3, :3],
        )
    else:
        block = part.blocks.get(MOUNTING)
        if block is None or block.covariance is None:
            return None
        name, expected, P = MOUNTING, block.expected, block.covariance
    C = part.C_EK if name == MOUNTING else so3.exp(ARCSEC * part.blocks[name].reference)
    return P, so3.exp(ARCSEC * expected) @ C


@dataclass(frozen=True, repr=False)
class JointSolution(Shown):
    """The mounting by all campaigns of an archive; ``document`` is what ``show --json`` prints."""

    made_by: ClassVar[str] = "Archive.show"

    document: dict[str, Any]

    @property
    def C_EK(self) -> Array:
        """The mounting (3, 3)."""
        return np.array(self.document["matrix"])

    @property
    def tables(self) -> Sequence[Table]:
        d = self.document
        rows = [("sigma", *_fixed(d["sigma_arcsec"]))]
        if d["sigma_from_data_arcsec"] is not None:
            rows.append(("sigma from the data", *_fixed(d["sigma_from_data_arcsec"])))
        rows.append(("95 % interval, +-", *_fixed(d["interval_95_arcsec"])))
        of = f" of {d['satellite']}" if d["satellite"] else ""
        n = len(d["campaigns"])
        caption = f"Joint mounting{of} from {d['from']} to {d['to']}, {counted(n, 'campaign')}"
        each = [
            (c["name"], c["first"][:19], *_fixed(c["correction_arcsec"]), *_fixed(c["sigma_arcsec"]))
            for c in d["campaigns"]
        ]
        rig = [
            (f"{m['camera']}{against}", *(("not known",) * 3 if sigma is None else _fixed(sigma)))
            for m in d.get("mountings", ())
            for against, sigma in _sigmas(m)
        ]
        cameras = [Table("Cameras, sigma", ("arcsec about", "x", "y", "z"), rig)] if rig else []
        head = (
            "campaign",
            "first image (UTC)",
            *(f"{axis} off" for axis in "xyz"),
            *(f"sigma {a}" for a in "xyz"),
        )
        return (
            Table(caption, ("arcsec about", "x", "y", "z"), rows),
            *cameras,
            Table("Each by itself, arcsec from the joint mounting", head, each, text_columns=2),
        )

    @property
    def sentences(self) -> Sequence[str]:
        d = self.document
        fit = d["fit"]
        quaternion = " ".join(f"{q:.12f}" for q in d["quaternion_xyzw"])
        lines = [
            f"quaternion x y z w: {quaternion}",
            f"chi-square {fit['chi2']:.1f} for {fit['degrees_of_freedom']} degrees of freedom "
            f"(p = {fit['chi2_p']:.3g})",
            *([f"status {d['status']}: {d['message']}"] if d["message"] else []),
        ]
        return (*lines, *(f"left out: {one['name']}, {one['reason']}" for one in d["left_out"]))


def _sigmas(mounting: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Those of one of several cameras, and of it against the first."""
    yield "", mounting["sigma_arcsec"]
    against = mounting["against_first"]
    if against is not None:
        yield f" against {against['to']}", against["sigma_arcsec"]


def _fixed(values: Sequence[float | None]) -> tuple[str, ...]:
    return tuple("" if value is None else f"{value:.3f}" for value in values)


def shown(name: str, database: sqlite3.Connection, instrument: Instrument) -> JointSolution:
    """The joint solution of an instrument."""
    found = standing(name, database, instrument)
    whole = joint(found.parts, mounting_known=found.mounting_known)
    own = points(found.own[1]).about(whole.C_EK)
    data, degrees = scatter(own)
    return JointSolution(_document(name, instrument, found, whole, own, data, degrees))


def _document(
    name: str,
    instrument: Instrument,
    found: Standing,
    whole: Joint,
    own: Points,
    data: Array | None,
    degrees: int,
) -> dict[str, Any]:
    from ...solve.probability import chdtrc, stdtrit

    sigma = np.sqrt(np.diagonal(whole.covariance_E))
    p = float(chdtrc(whole.degrees, whole.chi2)) if whole.degrees > 0 else None
    half = NORMAL_95 * sigma
    if data is not None:
        half = np.maximum(half, stdtrit(degrees, 0.975) * data)
    weak, rig = [*_weaknesses(own, p), *found.notices], {}
    if whole.cameras:
        from ...documents.cameras.mountings import joint_part

        widened = float(np.max(half / sigma)) / NORMAL_95
        rig = joint_part(whole, instrument.frame_from, instrument.frame_to, widened)
    return {
        "schema": "starplumb-archive-show/1",
        "archive": name,
        "satellite": instrument.satellite,
        "from": instrument.frame_from,
        "to": instrument.frame_to,
        "status": "weak" if weak else "ok",
        "message": "; ".join(weak),
        "matrix": numbers(whole.C_EK),
        "quaternion_xyzw": numbers(so3.to_quaternion(whole.C_EK)),
        "sigma_arcsec": numbers(sigma / ARCSEC),
        "covariance_arcsec2": numbers(whole.covariance_E / ARCSEC**2),
        "interval_95_arcsec": numbers(half / ARCSEC),
        **rig,
        "sigma_from_data_arcsec": None if data is None else numbers(data / ARCSEC),
        "degrees_of_freedom_from_data": degrees,
        "fit": {"chi2": numbers(whole.chi2), "degrees_of_freedom": whole.degrees, "chi2_p": p},
        "landmarks_shared": sum(name.startswith("landmark[") for name in shared_names(found.parts)),
        "campaigns": list(_each(found, own)),
        "left_out": [{"id": e.id, "name": e.name, "reason": reason} for e, reason in found.left_out],
    }


def _each(found: Standing, own: Points) -> Iterator[dict[str, Any]]:
    """Each campaign by itself; one of other cameras says nothing by itself, only with those that it is linked by."""
    said = {e.id: (v, s) for e, v, s in zip(found.own[0], own.value_E, own.sigma_E, strict=True)}
    nothing = np.full(3, np.nan), np.full(3, np.nan)
    for entry in found.entries:
        first, last = format_iso([entry.first_ns, entry.last_ns], "UTC")
        value, spread = said.get(entry.id, nothing)
        yield {
            "id": entry.id,
            "name": entry.name,
            "first": first,
            "last": last,
            "correction_arcsec": numbers(value / ARCSEC),
            "sigma_arcsec": numbers(spread / ARCSEC),
        }


def _weaknesses(own: Points, p: float | None) -> list[str]:
    """What weakens a joint solution, each in a sentence."""
    weak = []
    if p is not None and p < IMPLAUSIBLE_P:
        weak.append(
            f"the campaigns scatter more than their stated sigmas allow (p = {p:.2g}): the mounting may move, "
            "starplumb archive trend looks into it"
        )
    far = float(np.max(np.abs(own.value_E)) / ARCSEC)
    if far > FAR_ARCSEC:
        weak.append(
            f"a campaign is {far:.3g} arcsec from the joint mounting, beyond what its equations hold for"
        )
    return weak
