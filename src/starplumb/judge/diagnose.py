"""Which of the usual mistakes would explain the residuals of a campaign.

Each mistake (:mod:`starplumb.judge.conventions`) is undone in turn and the campaign calibrated again
(:mod:`starplumb.judge.trials`); then the best ones with sightings left out, and in pairs.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from ..physics.errors import InputError
from ..table.campaign import Campaign
from .consistency import DECISIVE
from .conventions.frames_and_times import misread_frames_and_times
from .conventions.image_and_ground import misread_image_and_ground
from .conventions.mistake import Mistake, Written
from .conventions.shown import shown_by_files
from .conventions.suspects import suspects
from .conventions.unknowns import unknowns
from .trials import Trial, by_directions, calibrated, misfit_of_images, thinned, tried, without_rejected

ENOUGH = 600
"""So many sightings tell mistakes apart; of more an even choice is used."""
ENOUGH_FOR_PAIRS = 150
"""So many of them tell pairs apart well enough to say which are worth a closer look."""
LEADERS = 5
"""Of the changes made alone, so many are looked at closely: with sightings left out, and together with others."""
PAIRS = 12
"""Of the pairs made of gross mistakes, so many are looked at closely."""


@dataclass(frozen=True)
class Diagnosis:
    """What was found: the campaign as it stands, all trials (the best first), and the one that explains it, if any.

    ``rivals`` explain it about as well as ``best`` does.  ``shown`` are other mistakes that the files show by
    themselves, whatever the residuals say.
    """

    stated: Trial
    trials: tuple[Trial, ...]
    best: Trial | None
    rivals: tuple[Trial, ...]
    shown: tuple[Mistake, ...] = ()

    @property
    def verdict(self) -> str:
        """``named``: a mistake explains the residuals, or the files show it; ``partly``: it explains much, not all;
        ``unexplained``: the residuals are implausible and no mistake explains them; ``none``: nothing is indicated."""
        if self.best is not None:
            return "named" if self.best.fits else "partly"
        return "none" if self.stated.fits else "unexplained"


def diagnose(campaign: Campaign, written: Written | None = None) -> Diagnosis:
    """Try the usual mistakes on a campaign; with sightings left out and in pairs where one alone does not explain it.

    Raises InputError where there is nothing to use.
    """
    search = _Search(thinned(campaign, ENOUGH), written or Written())
    search.alone()
    if not search.stated.fits:
        search.without_sightings()
    if not search.leader.fits:
        search.in_pairs()
    return search.diagnosis()


@dataclass
class _Search:
    """The trials made so far of one campaign."""

    campaign: Campaign
    written: Written
    trials: list[Trial] = field(default_factory=list)
    mistakes: list[Mistake] = field(default_factory=list)
    stated: Trial = field(init=False)

    def __post_init__(self) -> None:
        if not self.campaign.sightings.image.size:
            raise InputError(
                f"campaign {self.campaign.name!r} has no control points, wanted some to diagnose"
            )
        self.stated = calibrated(self.campaign, ())

    @property
    def leader(self) -> Trial:
        """The best trial: one that fits before any that does not; the simplest, which stands first, of equals."""
        return min([self.stated, *self.trials], key=_rank)

    def alone(self) -> None:
        """Each mistake by itself."""
        c = self.campaign
        self.mistakes = [
            *misread_image_and_ground(c),
            *misread_frames_and_times(c, self.written),
            *unknowns(c),
            *suspects(c, misfit_of_images(c)),
        ]
        evident = {mistake.kind for mistake in self.mistakes if mistake.evidence}
        self.mistakes += shown_by_files(c, evident)
        rough = [tried(c, (mistake,), roughly=True) for mistake in self.mistakes]
        best = min([self.stated.score, *(trial.score for trial in rough)])
        self.trials = [
            replace(trial, obstacle=trial.obstacle or NOT_CARRIED_ON)
            if trial.score > HOPELESS * max(best, DECISIVE)
            else tried(c, trial.undone)
            for trial in rough
        ]

    def without_sightings(self) -> None:
        """The campaign as it stands with the sightings left out that `robust` rejects; and so the best changes where
        none of them explains the residuals alone."""
        leaders = self._leaders()
        self.trials += self._rejecting(leaders[:1] if self.leader.fits else leaders)

    def _rejecting(self, leaders: Iterable[Trial]) -> list[Trial]:
        found = (without_rejected(self.campaign, trial.undone) for trial in leaders if not trial.fits)
        return [trial for trial in found if trial is not None]

    def _leaders(self) -> list[Trial]:
        """The campaign as it stands, and the best trial of each of a few kinds."""
        kinds: dict[str, Trial] = {}
        for trial in sorted((t for t in self.trials if len(t.undone) == 1), key=_rank):
            if trial.undone[0].kind not in UNSEEN:
                kinds.setdefault(trial.undone[0].kind, trial)
        return [self.stated, *list(kinds.values())[:LEADERS]]

    def in_pairs(self) -> None:
        """The best changes together with all others, then gross mistakes two by two."""
        sparse = thinned(self.campaign, ENOUGH_FOR_PAIRS)
        seen = [mistake for mistake in self.mistakes if mistake.kind not in UNSEEN]
        pairs = [
            (first, second)
            for first in (trial.undone[0] for trial in self._leaders() if trial.undone)
            for second in seen
            if second.kind != first.kind and not (first.free and second.free)
        ]
        rough = sorted((tried(sparse, pair, roughly=True) for pair in pairs), key=_rank)
        close = [*rough[:PAIRS], *self._gross(sparse)]
        found = [tried(self.campaign, trial.undone) for trial in close]
        self.trials += found
        if not self.leader.fits:
            self.trials += self._rejecting(sorted(found, key=_rank)[:LEADERS])

    def _gross(self, sparse: Campaign) -> list[Trial]:
        """The likeliest pairs of mistakes that move sightings by degrees, ordered by directions alone."""
        gross = [m for m in self.mistakes if m.kind in GROSS and not m.free]
        pairs = [(a, b) for i, a in enumerate(gross) for b in gross[i + 1 :] if a.kind != b.kind]
        return sorted((by_directions(sparse, pair) for pair in pairs), key=_rank)[:PAIRS]

    def diagnosis(self) -> Diagnosis:
        """The verdict of all trials."""
        best = self._best()
        trials = sorted(self.trials, key=lambda trial: (not trial.solved, *_rank(trial)))
        # where the files show a mistake, what fits as well is no rival
        rivals = (
            [] if best is None or best.evident else [t for t in trials if t is not best and _equals(t, best)]
        )
        shown = tuple(m for m in self.mistakes if m.evidence and (best is None or m not in best.undone))
        return Diagnosis(self.stated, tuple(trials), best, tuple(rivals), shown)

    def _best(self) -> Trial | None:
        """The leader, if it is decisively better than the campaign as it stands and not absurd.

        A mistake that the files show by themselves comes before it, unless the residuals contradict that.
        """
        leader = self.leader
        evident = [t for t in self.trials if t.evident and t.fits and not leader.better_than(t)]
        if evident:
            return min(evident, key=_rank)
        explains = leader is not self.stated and leader.better_than(self.stated) and not leader.absurd
        return leader if explains else None


HOPELESS = 100.0
"""Times as bad as the best after a few steps: a trial that is not carried on."""
NOT_CARRIED_ON = "far worse than others after two steps"
GROSS = ("pixels", "binning", "camera", "landmarks", "attitude", "ephemeris", "frames")
"""Kinds of mistakes that a turned mounting does not absorb, whatever else is wrong."""
UNSEEN = ("mounting", "axes", "horizon", "places")
"""Kinds that change no residual, at most the size of the correction: with them nothing fits that did not."""


def _rank(trial: Trial) -> tuple[bool, float]:
    """Order of trials: those that fit first, and none with a second mistake that is not needed."""
    return not trial.fits, trial.score + DECISIVE * len(trial.undone)


def _equals(trial: Trial, best: Trial) -> bool:
    """Whether a trial explains the data about as well as the best one, and no less simply."""
    simple = len(trial.undone) <= len(best.undone)
    return trial.solved and trial.fits == best.fits and simple and not best.better_than(trial)
