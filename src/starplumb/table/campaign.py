"""A campaign as physics: what was flown, measured and surveyed, in SI units and the frames of the package; no
files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..physics.camera import Camera
from ..physics.earth import C_JT, itrf_to_geodetic
from ..physics.light import Corrections
from ..physics.series import Attitude, Ephemeris, Orientation
from ..physics.trackers import FusedAttitude
from .cameras.rig import Rig
from .row_times import RowTimes

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Epochs = NDArray[np.int64]
SharedBy = Literal["image", "pass", "session", "campaign", "sample"]
"""What has one draw of an error in common."""


@dataclass(frozen=True)
class SharedErrors:
    """How the errors of attitude (rad, about E's axes) or position (m, along the axes of its sigmas) are shared.

    ``shared_by`` says what has one draw of the stated sigma, None where that is not stated: as "image";
    ``correlation_time_s`` makes it a process in time instead.  ``session_sigma`` (3,), or its square root (3, 3) or
    (m, 3, 3) of each image, is a further error, one draw a session, and ``wander_sigma`` (3,), or its square root
    (3, 3) or (m, 3, 3), one that changes within an image over ``wander_time_s``.  ``session_estimated`` has the sigma
    of a session taken from the data.
    """

    shared_by: SharedBy | None = None
    correlation_time_s: float | None = None
    session_sigma: Array | None = None
    wander_sigma: Array | None = None
    wander_time_s: float = 1.0
    session_estimated: bool = False

    @property
    def stated(self) -> bool:
        """Whether it is said which images share an error."""
        return self.shared_by is not None or self.correlation_time_s is not None

    @property
    def moved(self) -> bool:
        """Whether the stated error is not that of each image alone."""
        return self.correlation_time_s is not None or self.shared_by not in (None, "image")


@dataclass(frozen=True)
class Landmarks:
    """L surveyed markers: ``r_J`` (L, 3) m with ``covariance_J`` (L, 3, 3) m^2, known by ``ids`` without
    repetition.  ``common_sigma`` (3,) m east, north, up is a further error that those of one survey share; ``sources``
    names the survey of each, None for one.  ``correlation_length`` m makes the stated errors of one survey a process on
    the ground, correlated by ``exp(-distance / length)``, None for errors that know nothing of each other.  ``tie``
    (L,) says which are not surveyed, None for none: their place is a first guess, of no weight."""

    ids: tuple[str, ...]
    r_J: Array
    covariance_J: Array
    common_sigma: Array | None = None
    sources: tuple[str, ...] | None = None
    correlation_length: float | None = None
    tie: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        n = _distinct("landmark", self.ids)
        _shape("r_J", self.r_J, (n, 3))
        _shape("covariance_J", self.covariance_J, (n, 3, 3))

    @property
    def surveyed(self) -> NDArray[np.bool_]:
        """Which (L,) are no tie points."""
        return np.ones(len(self.ids), dtype=np.bool_) if self.tie is None else ~self.tie

    def moved(self, r_J: Array) -> Landmarks:
        """The same markers at other places (L, 3), their errors the same to the east, north and up there."""
        turn = C_JT(*itrf_to_geodetic(r_J)[:2]) @ C_JT(*itrf_to_geodetic(self.r_J)[:2]).mT
        return replace(self, r_J=r_J, covariance_J=turn @ self.covariance_J @ turn.mT)


@dataclass(frozen=True)
class Images:
    """m images taken at ``t_ns`` (m,): mid-exposure of a frame; of row 0 for a line scanner, whose rows
    follow one another by ``line_period_s`` (m,) (None for a frame).  ``tracker`` (m,) names the star
    tracker each attitude is from, ``passes`` and ``sessions`` (m,) the pass and session of each image, None where they
    are not distinguished; ``sigma_time_s`` (m,) is the sigma of each image's own error of time; ``row_times`` (m,) are
    the times of the rows of images whose rows are uneven, None for each other one; ``temperatures`` (m,) deg C by name
    are what the mounting may move with; ``camera`` (m,) names the camera of each, None where there is but one."""

    ids: tuple[str, ...]
    t_ns: Epochs
    line_period_s: Array | None = None
    name: str = "the images"
    """What messages call them: the user's file."""
    tracker: tuple[str, ...] | None = None
    passes: tuple[str, ...] | None = None
    sessions: tuple[str, ...] | None = None
    sigma_time_s: Array | None = None
    row_times: tuple[RowTimes | None, ...] | None = None
    temperatures: Mapping[str, Array] = field(default_factory=dict)
    camera: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        m = _distinct("image", self.ids)
        _shape("t_ns", self.t_ns, (m,))
        if self.t_ns.dtype != np.int64:
            raise ValueError(f"t_ns is {self.t_ns.dtype}, wanted int64")
        if self.line_period_s is not None:
            _shape("line_period_s", self.line_period_s, (m,))
        if self.sigma_time_s is not None:
            _shape("sigma_time_s", self.sigma_time_s, (m,))
        for name, values in self.temperatures.items():
            _shape(f"temperature {name}", values, (m,))
        for name in ("tracker", "passes", "sessions", "row_times", "camera"):
            names = getattr(self, name)
            if names is not None and len(names) != m:
                raise ValueError(f"{name} names {len(names)} images, wanted {m}")

    def exposed(self, image: Index, row_px: ArrayLike) -> Epochs:
        """Epochs (n,) of rows (n,) of images (n,): of the image itself, plus row periods for a line scanner."""
        if self.line_period_s is None:
            return self.t_ns[image]
        row = np.asarray(row_px, dtype=np.float64)
        late_ns = np.rint(1e9 * self.line_period_s[image] * row).astype(np.int64)
        for mine, table in self._tables(image):
            late_ns[mine] = table.late(row[mine])
        return np.asarray(self.t_ns[image] + late_ns)

    def period_s(self, image: Index, row_px: ArrayLike) -> Array:
        """Duration (n,) of rows (n,) of images (n,); zero for a frame camera."""
        if self.line_period_s is None:
            return np.zeros(image.shape)
        period, row = self.line_period_s[image], np.asarray(row_px, dtype=np.float64)
        for mine, table in self._tables(image):
            period[mine] = table.period_s(row[mine])
        return period

    def row_at(self, image: int, t_ns: Epochs) -> Array:
        """Rows (n,) of an image of a line scanner that are exposed at epochs (n,)."""
        late_ns, table = t_ns - self.t_ns[image], self.table_of(image)
        if table is not None:
            return table.row_at(late_ns)
        if self.line_period_s is None:
            raise ValueError("the rows of a frame camera are exposed at once")
        return np.asarray(1e-9 * late_ns / self.line_period_s[image])

    def table_of(self, image: int) -> RowTimes | None:
        """The times of an image's rows where they are uneven."""
        return None if self.row_times is None else self.row_times[image]

    def _tables(self, image: Index) -> Iterator[tuple[Index, RowTimes]]:
        """The tables of uneven rows, and which of the images (n,) each is of."""
        for i, table in enumerate(self.row_times or ()):
            if table is not None and (mine := np.flatnonzero(image == i)).size:
                yield mine, table


@dataclass(frozen=True)
class Sightings:
    """n marker images: indices ``image`` and ``landmark`` (n,), measured ``column_px`` and ``row_px`` (n,)
    with ``sigma_px`` (n,) in either, the root mean square of the two where an ``ellipse`` (n, 2, 2) gives their
    covariance over its square, None for a circle; ``check`` (n,) ones are kept out of the solution, to test it."""

    image: Index
    landmark: Index
    column_px: Array
    row_px: Array
    sigma_px: Array
    check: NDArray[np.bool_]
    ellipse: Array | None = None

    def __post_init__(self) -> None:
        for name in ("image", "landmark", "column_px", "row_px", "sigma_px", "check"):
            _shape(name, getattr(self, name), self.image.shape[:1])
        if self.ellipse is not None:
            _shape("ellipse", self.ellipse, (self.image.size, 2, 2))

    def blurred(self, further_px: float) -> Sightings:
        """The same with further noise of this sigma in column and row."""
        sigma_px = np.hypot(self.sigma_px, further_px)
        if self.ellipse is None:
            return replace(self, sigma_px=sigma_px)
        added = (further_px / self.sigma_px)[:, None, None] ** 2 * np.eye(2)
        shrunk = (self.sigma_px / sigma_px)[:, None, None] ** 2
        return replace(self, sigma_px=sigma_px, ellipse=shrunk * (self.ellipse + added))

    @classmethod
    def joined(cls, parts: Sequence[Sightings]) -> Sightings:
        """Those of several, one after another."""
        fields = ("image", "landmark", "column_px", "row_px", "sigma_px", "check")
        whole = {name: np.concatenate([getattr(part, name) for part in parts]) for name in fields}
        ellipse = None
        if any(part.ellipse is not None for part in parts):
            circles = [np.broadcast_to(np.eye(2), (part.image.size, 2, 2)) for part in parts]
            ellipse = np.concatenate(
                [c if p.ellipse is None else p.ellipse for p, c in zip(parts, circles, strict=True)]
            )
        return cls(**whole, ellipse=ellipse)


@dataclass(frozen=True)
class Detections:
    """n marker images whose landmark is not known: index ``image``, ``column_px``, ``row_px``, ``sigma_px``
    (n,) and perhaps an ``ellipse`` (n, 2, 2), as of :class:`Sightings`."""

    image: Index
    column_px: Array
    row_px: Array
    sigma_px: Array
    ellipse: Array | None = None

    def __post_init__(self) -> None:
        for name in ("image", "column_px", "row_px", "sigma_px"):
            _shape(name, getattr(self, name), self.image.shape[:1])
        if self.ellipse is not None:
            _shape("ellipse", self.ellipse, (self.image.size, 2, 2))

    def seen_as(self, rows: Index, landmark: Index) -> Sightings:
        """Some of them (k,), as sightings of landmarks (k,)."""
        return Sightings(landmark=landmark, check=np.zeros(rows.size, np.bool_), **vars(some_of(self, rows)))


Marks = TypeVar("Marks", bound=Sightings | Detections)


def some_of(marks: Marks, rows: Index | NDArray[np.bool_]) -> Marks:
    """Some of the marks."""
    chosen: dict[str, Any] = {
        name: None if values is None else values[rows] for name, values in vars(marks).items()
    }
    return replace(marks, **chosen)


@dataclass(frozen=True)
class Campaign:
    """Everything one calibration is made from.

    =================== =================== ==================================================================
    C_EK                (3, 3)              model mounting, that is to be corrected
    sigma_mounting      (3,) or None        prior knowledge of its error about E's axes, rad; None for nothing
    sigma_position      (3,)                position error an image's markers share, m, along ``position_frame``
    cov_attitude_E      (3, 3), (m, 3, 3)   of the attitude error an image's markers share, about E's axes, rad^2
    orientation                             of the Earth; needed where ``position_frame`` is inertial
    covariance_mounting (3, 3) or None      the whole covariance of that error, rad^2, in place of sigma_mounting
    turn_E              (m, 3) or None      how far the mounting is turned at each image, rad: ``exp(turn) C_EK``
    known_from                              what states that prior knowledge, for messages
    attitude_errors                         what is stated of who shares an error of attitude
    position_errors                         the same of the position error
    considered                              names of parameters that are not estimated and their sigmas, SI
    rig                                     the cameras by name where they have names; ``camera`` and ``C_EK`` are then
                                            the first one's
    =================== =================== ==================================================================
    """

    name: str
    camera: Camera
    C_EK: Array
    sigma_mounting: Array | None
    ephemeris: Ephemeris
    sigma_position: Array
    position_frame: Literal["ITRF", "GCRF", "TEME", "TOD", "MOD"]
    attitude: Attitude | FusedAttitude
    cov_attitude_E: Array
    landmarks: Landmarks
    images: Images
    sightings: Sightings
    corrections: Corrections
    orientation: Orientation | None = None
    attitude_errors: SharedErrors = SharedErrors()
    position_errors: SharedErrors = SharedErrors()
    covariance_mounting: Array | None = None
    turn_E: Array | None = None
    known_from: str = "mounting.sigma_arcsec"
    considered: tuple[tuple[str, float], ...] = ()
    rig: Rig | None = None

    def __post_init__(self) -> None:
        _shape("C_EK", self.C_EK, (3, 3))
        _shape("sigma_position", self.sigma_position, (3,))
        if self.sigma_mounting is not None:
            _shape("sigma_mounting", self.sigma_mounting, (3,))
        m = len(self.images.ids)
        if self.cov_attitude_E.shape not in ((3, 3), (m, 3, 3)):
            shape = self.cov_attitude_E.shape
            raise ValueError(f"cov_attitude_E has shape {shape}, wanted (3, 3) or ({m}, 3, 3)")
        if self.camera.scans and self.images.line_period_s is None:
            raise ValueError("a line scanner's images need their line_period_s")
        if self.position_frame != "ITRF" and self.orientation is None:
            raise ValueError("an inertial position_frame needs the orientation of the Earth")
        _indices("image", self.sightings.image, m)
        _indices("landmark", self.sightings.landmark, len(self.landmarks.ids))

    @property
    def several(self) -> bool:
        """Whether there is more than one camera."""
        return self.rig is not None and self.rig.several

    @property
    def prior_E(self) -> Array | None:
        """Covariance (3, 3) rad^2 of what was known of the model mounting; None for nothing."""
        if self.covariance_mounting is not None or self.sigma_mounting is None:
            return self.covariance_mounting
        return np.diag(self.sigma_mounting**2)

    @property
    def attitudes(self) -> tuple[Attitude, ...]:
        """The series of every star tracker."""
        attitude = self.attitude
        if isinstance(attitude, FusedAttitude):
            return tuple(tracker.attitude for tracker in attitude.trackers)
        return (attitude,)

    @property
    def one_attitude(self) -> Attitude:
        """The only series; ValueError where the attitude is that of several trackers."""
        (only,) = self.attitudes
        return only

    def with_attitude(self, change: Callable[[Attitude], Attitude]) -> Campaign:
        """The campaign with ``change`` made to its attitude, to the series of every tracker where there are several."""
        attitude = self.attitude
        changed = attitude.each(change) if isinstance(attitude, FusedAttitude) else change(attitude)
        return replace(self, attitude=changed)


def _shape(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}, wanted {shape}")


def _distinct(kind: str, ids: tuple[str, ...]) -> int:
    if len(set(ids)) != len(ids):
        raise ValueError(f"the {kind} ids repeat")
    return len(ids)


def _indices(kind: str, index: Index, count: int) -> None:
    if index.size and not (index.min() >= 0 and index.max() < count):
        raise ValueError(f"a sighting's {kind} index lies outside 0 .. {count - 1}")
