"""What the verbs of ``starplumb archive`` print."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from ..document import Document, Finite, Matrix3, Number, Numbers3, Part


class Withdrawal(Part):
    """When and why a campaign was withdrawn (UTC)."""

    time: str
    reason: str


class ArchiveEntryDocument(Document):
    """One campaign of an archive, as ``list`` prints them; times in UTC.  ``counts`` says whether it is in the joint
    solution, ``why_not`` why it is not."""

    schema_: Literal["starplumb-archive-entry/1"] = Field(alias="schema")
    id: str
    name: str
    satellite: str
    from_: str = Field(alias="from")
    to: str
    first: str
    last: str
    added: str
    status: str
    method: str
    software: str
    images: int
    observations: int
    counts: bool
    why_not: str | None
    withdrawn: Withdrawal | None


class ArchiveInitDocument(Document):
    """An archive that was made."""

    schema_: Literal["starplumb-archive-init/1"] = Field(alias="schema")
    archive: str
    satellite: str


class Added(Part):
    """A campaign that was asked to be added; ``new`` is false where it was there already, ``kept`` true where all its
    files are kept beside the archive, so that it can be run again.  ``satellite`` is the one that it has there."""

    id: str
    name: str
    satellite: str
    status: str
    new: bool
    kept: bool


class ArchiveAddDocument(Document):
    """Campaigns that were added."""

    schema_: Literal["starplumb-archive-add/1"] = Field(alias="schema")
    archive: str
    campaigns: list[Added]
    notices: list[str]


class InJoint(Part):
    """A campaign of the joint solution: how far its own answer is turned from the joint one and, in sigmas, what its
    images alone say of it."""

    id: str
    name: str
    first: str
    last: str
    correction_arcsec: Numbers3
    sigma_arcsec: Numbers3


class Fit(Part):
    """Chi-square of the joint solution and its probability."""

    chi2: Number
    degrees_of_freedom: int
    chi2_p: Number


class AgainstFirst(Part):
    """A camera's mounting against the first camera's, ``to``, with the covariance of the difference about E's axes."""

    to: str
    matrix: Matrix3
    sigma_arcsec: Numbers3 | None
    covariance_arcsec2: Matrix3 | None


class InRig(Part):
    """The mounting of one of several cameras; null where nothing determines it."""

    camera: str
    from_: str = Field(alias="from")
    to: str
    matrix: Matrix3
    quaternion_xyzw: list[float]
    sigma_arcsec: Numbers3 | None
    covariance_arcsec2: Matrix3 | None
    interval_95_arcsec: Numbers3 | None
    against_first: AgainstFirst | None


class ArchiveShowDocument(Document):
    """The joint solution of the campaigns of one mounting: of all their sightings, each landmark and each survey being
    one unknown.  ``sigma_arcsec`` and ``covariance_arcsec2`` are from the stated errors, ``sigma_from_data_arcsec``
    from the scatter of the campaigns.  Of several cameras the mounting is that of ``from``, and ``mountings`` has all,
    each against the first too."""

    schema_: Literal["starplumb-archive-show/1"] = Field(alias="schema")
    archive: str
    satellite: str
    from_: str = Field(alias="from")
    to: str
    status: Literal["ok", "weak"]
    message: str
    matrix: Matrix3
    quaternion_xyzw: list[float]
    sigma_arcsec: Numbers3
    covariance_arcsec2: Matrix3
    interval_95_arcsec: Numbers3
    mountings: list[InRig] | None = None
    mountings_covariance_arcsec2: list[list[Finite]] | None = None
    sigma_from_data_arcsec: Numbers3 | None
    degrees_of_freedom_from_data: int
    fit: Fit
    landmarks_shared: int
    campaigns: list[InJoint]
    left_out: list[dict[str, Any]]


class ArchiveWithdrawDocument(Document):
    """A campaign that was withdrawn."""

    schema_: Literal["starplumb-archive-withdraw/1"] = Field(alias="schema")
    archive: str
    id: str
    name: str
    reason: str


class ArchiveMergeDocument(Document):
    """What came new into an archive from another."""

    schema_: Literal["starplumb-archive-merge/1"] = Field(alias="schema")
    archive: str
    merged: str
    campaigns: int
    events: int
    issued: int
    withdrawn: int


class ArchiveVerifyDocument(Document):
    """What is wrong with an archive, the campaigns whose files are not kept, which cannot be run again, and the digests
    of files that are kept for none: a killed addition leaves them, and the same addition uses them."""

    schema_: Literal["starplumb-archive-verify/1"] = Field(alias="schema")
    archive: str
    campaigns: int
    faults: list[str]
    not_kept: dict[str, list[str]]
    left_over: list[str]


class Rerun(Part):
    """A campaign calibrated again: how far its mounting is from the one in the archive, also in sigmas of that, and the
    sigmas over those; ``changed`` by more than a hundredth of a sigma, or in status."""

    id: str
    name: str
    software_then: str
    status_then: str
    status_now: str
    change_arcsec: Numbers3
    change_sigmas: Numbers3 | None
    sigma_ratio: Numbers3 | None
    changed: bool
    message: str


class NotRun(Part):
    """A campaign that could not be calibrated again."""

    id: str
    name: str
    reason: str


class ArchiveRerunDocument(Document):
    """The campaigns of an archive calibrated again with this program."""

    schema_: Literal["starplumb-archive-rerun/1"] = Field(alias="schema")
    archive: str
    software: str
    campaigns: list[Rerun]
    not_run: list[NotRun]
