"""What the data say of the stated sigmas, source by source, in plain sentences."""

from __future__ import annotations

from ...estimators.usable import EXACT
from ...physics.errors import counted
from ..trust import Finding, probability
from .from_data import SIGHTINGS, FromData, SourceFound
from .next_session import FEW_SESSIONS, NextSession
from .times import TimesFound

TOO_SMALL_P, TOO_LARGE_P = 1e-3, 1e-4
"""Probability, over the number of sources, below which a source is said to be larger or smaller than stated: larger
harms the answer, smaller is a hint."""
BEYOND = 10.0
"""Ratio to what is stated from which on an error is no larger variance but something wrong: residuals of whole images
are held to the limit that holds for those of sightings, surely where there are images enough to tell."""
FEW_IMAGES = 5
"""Images up to which their scatter confirms nothing: with five a sigma stated half is missed more often than found."""


def findings_of_sources(found: FromData | None, images: int) -> list[Finding]:
    """Sources that are not as stated, and whether anything confirms those that are; ``images`` are those used."""
    if found is None:
        return [] if images < 2 else [_unconfirmed(images)]
    others = any(_surely_larger(source, len(found.sources)) for source in found.sources)
    spoken = [source for source in found.sources if not (others and _explained(source))]
    few = found.images <= FEW_IMAGES
    told = [one for one in (_told(source, len(found.sources), few) for source in spoken) if one is not None]
    if found.times is not None and found.times.p < TOO_SMALL_P and not any(one.weakens for one in told):
        told.append(_times(found.times))
    if found.next_session is not None and found.next_session.groups < FEW_SESSIONS:
        told.append(_few(found.next_session))
    if found.single:
        return [*told, _one_draw(found.single)]
    confirmed = found.images > FEW_IMAGES or any(finding.weakens for finding in told)
    return told if confirmed else [*told, _unconfirmed(found.images)]


def _unconfirmed(images: int) -> Finding:
    return Finding(
        f"nothing here confirms the stated sigmas of attitude and orbit: the scatter of {counted(images, 'image')} "
        f"cannot tell; more than {FEW_IMAGES} images would",
        False,
    )


def _one_draw(single: tuple[str, ...]) -> Finding:
    return Finding(
        f"nothing here confirms the stated sigmas of {' and of '.join(single)}: all images share one draw of "
        "these errors; images of further passes would",
        False,
    )


def _few(further: NextSession) -> Finding:
    return Finding(
        f"what a further {further.of} adds is hardly told by {further.groups}: its interval (next_session) is wide for "
        f"it, {FEW_SESSIONS} or more would narrow it",
        False,
    )


def _times(times: TimesFound) -> Finding:
    return Finding(
        f"the images disagree along the flight ({probability(times.p)}), as if each had a time of its own, wrong by "
        f"{1e3 * times.sigma_s:.2g} ms: look at the times of the images, or state sigma_time_s if they are as coarse; "
        "the interval is widened by it",
        True,
        covariance_E=times.covariance_E,
    )


def _explained(source: SourceFound) -> bool:
    """Whether estimated beside the others it may be as stated, whatever its own test says: each test takes the other
    sources as stated, so that one which is not alarms them all."""
    return source.interval is not None and source.interval[0] <= 1.0 and source.p < 0.5


def _surely_larger(source: SourceFound, count: int) -> bool:
    return source.p < TOO_SMALL_P / count and not _explained(source)


def _told(source: SourceFound, count: int, few: bool) -> Finding | None:
    if source.p < TOO_SMALL_P / count:
        return _too_small(source, few)
    if source.p > 1.0 - TOO_LARGE_P / count and source.stated > 0.0:
        cause = "the stated sigma is too large"
        if source.kind != SIGHTINGS:
            cause = (
                f"the images of a pass may share most of it, which their scatter does not show (shared_by), or "
                f"{cause}; do not lower it for this alone"
            )
        return Finding(f"{_ratio(source)}, less than it need be: {cause}", False)
    return None


def _too_small(source: SourceFound, few: bool) -> Finding | None:
    if source.stated == 0.0:
        return Finding(
            f"{source.name} is not stated: {source.found:.2g} {source.unit} ({probability(source.p)}); the interval is "
            "that of the scatter; state shared_by or a session's sigma in [attitude] and [ephemeris]",
            True,
        )
    if source.kind == SIGHTINGS:
        exact = source.ratio is not None and source.ratio <= EXACT
        return Finding(
            f"{_ratio(source)} ({probability(source.p)}); the interval is widened by it", not exact
        )
    assert source.ratio is not None
    assert source.interval is not None
    refutes = (source.ratio if few else source.interval[0]) > BEYOND
    if source.ratio <= 1.0:
        return Finding(
            f"the images disagree ({probability(source.p)}), and no variance of what is stated explains it: run "
            "starplumb diagnose",
            True,
        )
    meaning = (
        "this is no matter of a sigma, and the answer cannot be believed: run starplumb diagnose"
        if refutes
        else "it is worse than stated, its times are wrong, or the mounting moves; the interval is that of their "
        "scatter"
    )
    return Finding(
        f"the images disagree: {_ratio(source)} ({probability(source.p)}): {meaning}", True, refutes=refutes
    )


def _ratio(source: SourceFound) -> str:
    assert source.ratio is not None
    assert source.interval is not None
    low, high = source.interval
    times = f"{source.ratio:.2g} ({low:.2g} to {high:.2g}) times"
    return f"{source.name} is {times} the stated {source.stated:.3g} {source.unit}"
