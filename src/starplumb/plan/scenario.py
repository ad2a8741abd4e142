"""A scenario: one true scene, the errors that its measurements have, and those that the estimators know of."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..estimators.fit import Unknowns
from ..physics import so3
from ..physics.earth import C_JT, itrf_to_geodetic
from ..table.cameras.mounting import CameraMounting
from ..table.cameras.views import of_camera
from ..table.campaign import Campaign
from ..table.equation import Linearised, linearise
from ..table.error_sources import Distribution, Source, state
from ..table.geometry import locate, observe
from ..table.observations import Observations

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Initial:
    """Error of the model mounting from which trials start: ``sigma`` (3,) rad about E; ``stated`` as a prior or not."""

    sigma: Array
    distribution: Distribution = field(default_factory=Distribution)
    stated: bool = False


@dataclass(frozen=True)
class Scenario:
    """``campaign`` is the scene as it truly is, ``truth`` its table without error, ``C_EK_true`` the mounting.

    ``sources`` are the errors there are, ``stated_sources`` those the estimators know of.
    """

    name: str
    description: str
    campaign: Campaign
    truth: Observations
    C_EK_true: Array
    sources: tuple[Source, ...]
    stated_sources: tuple[Source, ...]
    initial: Initial

    @classmethod
    def of(
        cls,
        campaign: Campaign,
        sources: Sequence[Source],
        *,
        omit: Iterable[str] = (),
        factor: Mapping[str, float] | None = None,
        initial: Initial | None = None,
        description: str = "",
    ) -> Scenario:
        """A scenario from plain objects: a true ``campaign`` (its series, survey and pixels without error, its ``C_EK``
        the true mounting, as :mod:`starplumb.plan.scene` makes them) and the errors that its measurements have
        (:mod:`starplumb.plan.error_catalogue`).

        ``omit`` names sources that the estimators do not know of; ``factor`` is stated over true sigma by name.
        Blunders are never stated.  Without ``initial`` every trial starts from the true mounting.
        """
        left_out, factors = set(omit), dict(factor or {})
        stated = tuple(
            source.scaled(factors.get(source.name, 1.0))
            for source in sources
            if source.name not in left_out and not source.is_blunder
        )
        start = Initial(np.zeros(3)) if initial is None else initial
        truth = observe(campaign)
        return cls(campaign.name, description, campaign, truth, campaign.C_EK, tuple(sources), stated, start)

    @cached_property
    def model(self) -> Linearised:
        """The measurement equation at the truth."""
        return linearise(self.truth, self.C_EK_true)

    @cached_property
    def C_EC_true(self) -> Array:
        """The mountings of all cameras (k, 3, 3), the first being ``C_EK_true``."""
        rig = self.campaign.rig
        return self.C_EK_true[None] if rig is None else self.C_EK_true @ rig.C_KC

    @cached_property
    def unknowns(self) -> Unknowns:
        """The alignment, and of several cameras the mountings of the further ones."""
        names = () if self.campaign.rig is None else self.campaign.rig.names[1:]
        return Unknowns(tuple(CameraMounting(k, name) for k, name in enumerate(names, start=1)))

    @property
    def prior_E(self) -> Array | None:
        return np.diag(self.initial.sigma**2) if self.initial.stated else None

    @cached_property
    def stated(self) -> Observations:
        """The table without error, its stated errors those of ``stated_sources``."""
        return self.with_stated(self.stated_sources)

    def with_stated(self, sources: tuple[Source, ...]) -> Observations:
        """The table without error with other stated sources."""
        return replace(state(self.truth, sources, self.model), prior_E=self.prior_E)

    def alone(self, name: str, floor: float = 1e-3) -> Scenario:
        """The scenario with one source only, truly and as stated; pixel noise stays at ``floor`` of itself, for no
        solution does without."""

        sources = tuple(
            source if source.name == name else source.scaled(floor)
            for source in self.sources
            if source.name == name or (source.field == "pixel" and not source.is_blunder)
        )
        return replace(self, sources=sources, stated_sources=tuple(s for s in sources if not s.is_blunder))

    @property
    def model_is_true(self) -> bool:
        """Whether the estimators know the errors as they are."""
        stated = {source.name: source for source in self.stated_sources}
        return len(stated) == len(self.sources) and all(
            source.name in stated
            and not source.is_blunder
            and np.array_equal(stated[source.name].sigma, source.sigma)
            for source in self.sources
        )

    @cached_property
    def ground_m(self) -> Array:
        """Displacement east and north (m) on the ellipsoid of the centre of each image by theta_E, (m, 2, 3) m/rad.

        By central differences over 2e-6 rad, exact to 1e-5 of itself; the centre is the mean of the image's markers.
        Of several cameras the images are those of the first.
        """
        campaign = of_camera(self.campaign, 0)
        s = campaign.sightings
        images = np.unique(s.image)
        counts = np.bincount(s.image)[images]
        column, row = (np.bincount(s.image, px)[images] / counts for px in (s.column_px, s.row_px))

        def place(theta: Array) -> Array:
            return locate(campaign, so3.exp(theta) @ self.C_EK_true, images, column, row)

        step = 1e-6
        difference = [(place(step * axis) - place(-step * axis)) / (2.0 * step) for axis in np.eye(3)]
        latitude, longitude, _ = itrf_to_geodetic(place(np.zeros(3)))
        return np.asarray(C_JT(latitude, longitude).mT[:, :2] @ np.stack(difference, axis=-1))

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all that the measurements and estimates depend on."""
        digest = sha256()
        parts = (self.truth, self.C_EK_true, self.sources, self.stated_sources, self.initial)
        for part in (*parts, self.ground_m):
            _feed(digest, part)
        return digest.hexdigest()


def _feed(digest: Any, part: object) -> None:
    """Walk dataclasses and tuples down to arrays, numbers and words, each with its type and shape."""
    if is_dataclass(part):
        digest.update(type(part).__name__.encode())
        for entry in fields(part):
            digest.update(entry.name.encode())
            _feed(digest, getattr(part, entry.name))
    elif isinstance(part, tuple):
        digest.update(f"({len(part)}".encode())
        for item in part:
            _feed(digest, item)
    elif isinstance(part, np.ndarray):
        digest.update(f"{part.dtype}{part.shape}".encode())
        digest.update(np.ascontiguousarray(part).tobytes())
    else:
        digest.update(repr(part).encode())
