"""DIMAP metadata of line scanners: Pleiades 1A/1B, SPOT 6/7, Pleiades Neo and kin, as they come with sensor images.

Two layouts are read here: that of production (``Sensor_Model_Characteristics``), which also has the telemetry, and the
delivered one of version 2 (``Refined_Model``); version 1, of SPOT 1 to 5, is read in :mod:`.spot_dimap`.
The vendor counts rows and columns from 1; row 1 is exposed at START.  His camera axes V have x along track and z down,
his look direction is ``(tan PsiY, -tan PsiX, 1)``, his quaternions take V to ITRF and stand scalar first.  Orbits are
Lagrange interpolations of his positions of degree 7; velocities are not read (some products state them inertial, some
relative to the turning Earth).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...physics.light import Corrections
from ...physics.timescales import format_iso
from ..text.files import show
from ..text.tree import Array, Epochs, Node, read_xml, require_increasing
from .dimap_attitude import AttitudeSamples, quaternion_list, sampled_polynomial, telemetry
from .dimap_frame import corners_of
from .dimap_reach import reaching
from .spot_dimap import LOOK_ANGLES, read_spot
from .vendor import C_KV, AttitudeChoice, Detectors, Product

_METRE = {"m": 1.0}
_PERIODS = {"s": 1.0, "ms": 1e-3, "millisecond": 1e-3, "us": 1e-6, "microsecond": 1e-6}
_PERIOD_TOLERANCE = 0.01
"""How far rows times line period may be from END - START, relative: some files round these to a millisecond."""
_MOST_LATE_S = 1.0
"""A row dated farther than this from START and the line period is one of another image."""
_MOST_ROW = 1e9
_NODES = 8
"""Positions the vendor's interpolation uses."""
_COLUMN_STEP = 16
"""Columns between look directions that are not linear in the column."""


@dataclass(frozen=True)
class _Layout:
    """Where a layout keeps what; places below ``model`` but for the last two."""

    model: str
    range: str
    period: str
    points: str
    position: str
    point_time: str
    polynomial: str
    scaling: str
    first_column: str
    level: str
    name: str


_PRODUCTION = _Layout(
    model="Geometric_Data/Sensor_Model_Characteristics",
    range="UTC_Sensor_Model_Range",
    period="SENSOR_LINE_PERIOD",
    points="Sensor_Ephemeris/Point_List",
    position="LOCATION_VALUES",
    point_time="UTC_TIME",
    polynomial="Sensor_Attitudes/Polynomial_Models",
    scaling="Sensor_Attitudes",
    first_column="Sensor_Viewing_Model/Position_In_Retina/FIRST_COL",
    level="Product_Characteristics/PROCESSING_LEVEL",
    name="Dataset_Identification/DATASET_NAME",
)
_DELIVERED = _Layout(
    model="Geometric_Data/Refined_Model",
    range="Time/Time_Range",
    period="Time/Time_Stamp/LINE_PERIOD",
    points="Ephemeris/Point_List",
    position="LOCATION_XYZ",
    point_time="TIME",
    polynomial="Attitudes/Polynomial_Quaternions",
    scaling="Attitudes/Polynomial_Quaternions",
    first_column="Geometric_Calibration/Instrument_Calibration/Swath_Range/FIRST_COL",
    level="Processing_Information/Product_Settings/PROCESSING_LEVEL",
    name="Dataset_Identification/DATASET_NAME",
)


@dataclass(frozen=True)
class _Timing:
    """Epoch of row 1, line period and the number of rows."""

    t_ns: int
    period_s: float
    rows: int

    @property
    def end_ns(self) -> int:
        """Epoch of the last row."""
        return self.t_ns + round(1e9 * self.period_s * (self.rows - 1))


def read_dimap(path: Path, attitude: AttitudeChoice = "vendor", band: str | None = None) -> Product:
    """The image a DIMAP file describes, in our axes.

    ``attitude``: ``vendor``, camera to ITRF as he locates with it (its light effects are in the attitude, so that ours
    are off; refraction is on where he states that he counts it), or the telemetry ``filtered`` or ``raw``, AOCS frame
    to J2000 (ours are on; only in the production layout).  ``band`` names the band whose look directions are read where
    a file has those of several.
    Raises InputError for what is missing, contradicts itself or would have to be guessed.
    """
    root = read_xml(path)
    if root.find(LOOK_ANGLES) is not None:
        return read_spot(root, attitude, band)
    layout = _layout(root)
    model = root.need(layout.model)
    _require_systems(root, layout, model)
    raster = _raster(root, band)
    columns = raster.need("NCOLS").whole(2)
    timing = _timing(raster.need("NROWS").whole(2), layout, model)
    orbit_t_ns, r_J, further_ns = reaching(*_orbit(layout, model), timing.t_ns, timing.end_ns)
    continued = _continued(path, "orbit", further_ns)
    own = attitude == "vendor"
    chosen = telemetry(root, attitude) if attitude != "vendor" else _vendor_attitude(layout, model, timing)
    return Product(
        path=path,
        name=root.need(layout.name).text or path.stem,
        columns=columns,
        rows=timing.rows,
        detectors=_detectors(layout, model, columns, band, _is_neo(root)),
        t_ns=timing.t_ns,
        line_period_s=timing.period_s,
        orbit_t_ns=orbit_t_ns,
        r_J=r_J,
        v_J=None,
        attitude_t_ns=chosen.t_ns,
        q_EF=chosen.q_EF,
        frame=chosen.frame,
        C_EK=C_KV.mT,
        own_mounting=own,
        corrections=Corrections(
            light_time=not own, aberration=not own, refraction=_setting(root, "ATMOSPHERIC_REFRACTION")
        ),
        corners=corners_of(
            root.find("Product_Frame/Dataset_Frame") or root.find("Dataset_Content/Dataset_Extent")
        ),
        notices=(*_row_times(root, timing), *_light(root), *continued, *chosen.notices),
    )


def _is_neo(root: Node) -> bool:
    profile = root.find("Metadata_Identification/METADATA_PROFILE")
    return profile is not None and profile.text.startswith("PNEO")


def _setting(root: Node, name: str) -> bool:
    """Whether the vendor states that his location counts an effect; products before Pleiades Neo do not say."""
    node = root.find(f"Processing_Information/Product_Settings/Geometric_Settings/{name}_SETTING")
    return node is not None and node.text.strip().lower() == "true"


def _light(root: Node) -> tuple[str, ...]:
    if not _setting(root, "LIGHT_SPEED"):
        return ()
    return (
        f"{root.path}: LIGHT_SPEED_SETTING is true, which no product known to this reader states: see by its corners "
        "whether light_time and aberration of [corrections] belong on",
    )


def _layout(root: Node) -> _Layout:
    for layout in (_PRODUCTION, _DELIVERED):
        if root.find(layout.model) is not None:
            return layout
    for level in (root.find(layout.level) for layout in (_PRODUCTION, _DELIVERED)):
        if level is not None:
            _require_sensor(level)
    kind = root.find("Metadata_Identification/METADATA_SUBPROFILE")
    found = f"a {kind.text} file" if kind else f"the element {root.name}"
    raise root.error(
        f"{found} without a sensor model", f"a DIMAP product with {_PRODUCTION.model} or {_DELIVERED.model}"
    )


def _raster(root: Node, band: str | None) -> Node:
    """The element with NROWS and NCOLS: of the image, or in some dialects of each of its bands."""
    place = "Raster_Dimensions" if root.find("Raster_Dimensions") else "Raster_Data/Raster_Dimensions"
    raster = root.need(place)
    if raster.find("NROWS") is not None:
        return raster
    bands = raster.below("Band_Dimensions")
    sizes = {(node.need("NROWS").text, node.need("NCOLS").text): node for node in bands}
    named = {node.need("BAND_ID").text: node for node in bands if len(sizes) > 1}
    if band in named:
        return named[band]
    if named:
        raise raster.error(f"bands of different sizes, {', '.join(named)}", "one of them as band")
    return bands[0] if bands else raster.need("NROWS")


def _require_sensor(level: Node) -> None:
    if level.text != "SENSOR":
        raise level.error(show(level.text), '"SENSOR", an image in the geometry of its sensor')


def _require_systems(root: Node, layout: _Layout, model: Node) -> None:
    """Raise InputError where the product is no sensor image or names other systems than UTC and WGS 84."""
    _require_sensor(root.need(layout.level))
    scale = model.find("Coordinate_Reference_System/Temporal_CRS/TEMPORAL_CRS_NAME")
    if scale is not None and scale.text != "UTC":
        raise scale.error(show(scale.text), '"UTC"')
    frame = model.find("Coordinate_Reference_System/Geodetic_CRS/GEODETIC_CRS_CODE")
    if frame is not None and not frame.text.endswith(":4978"):
        raise frame.error(show(frame.text), "EPSG 4978, geocentric WGS 84")
    origin = root.find("Product_Frame/PIXEL_ORIGIN") or root.find("Geoposition/Raster_CRS/PIXEL_ORIGIN")
    if origin is not None and origin.text != "1":
        raise origin.error(show(origin.text), "rows and columns counted from 1")


def _timing(rows: int, layout: _Layout, model: Node) -> _Timing:
    """When the rows were exposed; the line period and its unit must agree with START, END and the number of rows."""
    start, end = model.need(f"{layout.range}/START").epoch(), model.need(f"{layout.range}/END").epoch()
    node = model.need(layout.period)
    duration = (end - start) * 1e-9
    stated = node.unit(_PERIODS)
    candidates = [stated] if stated is not None else sorted(set(_PERIODS.values()))
    fitting = [
        node.positive() * unit
        for unit in candidates
        if abs(node.positive() * unit * rows - duration) <= _PERIOD_TOLERANCE * abs(duration)
    ]
    if len(fitting) != 1:
        unit_text = node.element.get("unit", "s, ms or us")
        raise node.error(
            f"{show(node.text)} {unit_text} for {rows} rows from START to END in {duration:.6g} s",
            f"{duration / rows:.6g} s",
        )
    return _Timing(start, fitting[0], rows)


def _row_times(root: Node, timing: _Timing) -> tuple[str, ...]:
    """A notice where the product dates rows otherwise than its sensor model does, as delivered ones of SPOT 6 and 7 do.

    Raises InputError where the two are so far apart that they belong to different images.
    """
    area = root.find("Geometric_Data/Use_Area")
    late = []
    for located in area.all("Located_Geometric_Values") if area else []:
        row, time = located.find("ROW"), located.find("TIME")
        if row is None or time is None:
            continue
        if abs(row.number()) > _MOST_ROW:
            raise row.error(show(row.text), "a row of the image")
        expected = timing.t_ns + 1e9 * timing.period_s * (row.number() - 1.0)
        late.append((time.epoch() - expected) * 1e-9)
        if abs(late[-1]) > _MOST_LATE_S:
            wanted = format_iso(round(expected), "UTC")[0]
            raise time.error(
                f"{show(time.text)} for row {row.text}", f"{wanted} by START and the line period"
            )
    worst = max(late, key=abs, default=0.0)
    if abs(worst) <= timing.period_s + 1e-6:
        return ()
    return (
        f"{root.path}: Use_Area dates rows {worst * 1e3:.4g} ms later than START and the line period; these are used, "
        "since they are those of the sensor model",
    )


def _orbit(layout: _Layout, model: Node) -> tuple[Epochs, Array]:
    points = model.need(layout.points).all("Point")
    if len(points) < _NODES:
        where = model.need(layout.points)
        raise where.error(
            f"{len(points)} positions", f"at least {_NODES} (the vendor's interpolation needs them)"
        )
    places = [point.need(layout.position) for point in points]
    r_J = np.stack([place.numbers(3) * (place.unit(_METRE) or 1.0) for place in places])
    t_ns = np.array([point.need(layout.point_time).epoch() for point in points])
    require_increasing(points, t_ns)
    return t_ns, r_J


def _vendor_attitude(layout: _Layout, model: Node, timing: _Timing) -> AttitudeSamples:
    """Camera to ITRF: polynomials, or a list of quaternions."""
    polynomial = model.find(layout.polynomial)
    if polynomial is not None:
        return sampled_polynomial(polynomial, model.need(layout.scaling), timing.t_ns, timing.end_ns)
    listed = model.find("Attitudes/Quaternion_List")
    if listed is None:
        raise model.error("neither polynomials nor a list of quaternions", layout.polynomial)
    listed_ones = quaternion_list(listed, "ITRF", "UTC", "TIME")
    t_ns, q, further_ns = reaching(listed_ones.t_ns, listed_ones.q_EF, timing.t_ns, timing.end_ns)
    return AttitudeSamples(
        t_ns,
        q / np.linalg.norm(q, axis=-1, keepdims=True),
        "ITRF",
        (*listed_ones.notices, *_continued(model.path, "attitude", further_ns)),
    )


def _continued(path: Path, what: str, further_ns: int) -> tuple[str, ...]:
    said = f"{path}: its {what} ends up to {further_ns / 1e6:.3g} ms short of the image, and is continued"
    return (said,) if further_ns else ()


def _detectors(layout: _Layout, model: Node, columns: int, band: str | None, from_image: bool) -> Detectors:
    """Tangents as polynomials of the detector, counted from 0 where the vendor's first is 1; ``from_image`` where the
    first is that of the image, whichever of the line it is."""
    first = model.find(layout.first_column)
    skipped = first.whole(1) - 1 if first and not from_image else 0
    if layout is _PRODUCTION:
        directions = model.need("Sensor_Viewing_Model/Viewing_Directions")
        psi_x = directions.need("PsiX_Model/COEFFICIENTS").numbers()
        psi_y = directions.need("PsiY_Model/COEFFICIENTS").numbers()
    else:
        angles = _look_angles(model, band)
        psi_x, psi_y = _series(angles, "XLOS"), _series(angles, "YLOS")
    if not np.any(psi_x[1:]) and not np.any(psi_y[1:]):
        raise model.error("look directions that do not turn with the column", "PsiX or PsiY that do")
    step = _COLUMN_STEP if max(psi_x.size, psi_y.size) > 2 else columns - 1
    column = np.unique(np.append(np.arange(0, columns, step), columns - 1)).astype(np.float64)
    polynomial = np.polynomial.polynomial.polyval
    tan_x, tan_y = (np.asarray(polynomial(column + skipped, psi), dtype=np.float64) for psi in (psi_x, psi_y))
    return Detectors.from_vendor(column, tan_y, -tan_x)


def _look_angles(model: Node, band: str | None) -> Node:
    """The one element of look angles: of the instrument, of its only band, or of ``band``."""
    instrument = model.need("Geometric_Calibration/Instrument_Calibration")
    direct = instrument.find("Polynomial_Look_Angles")
    if direct is not None:
        return direct
    bands = instrument.need("Band_Calibration_List").all("Band_Calibration")
    if len({tuple(_written(node)) for node in bands}) == 1 and not band:
        bands = bands[:1]
    named = {node.need("BAND_ID").text: node for node in bands} if len(bands) > 1 or band else {}
    if band in named:
        return named[band].need("Polynomial_Look_Angles")
    if named:
        found = f"the bands {', '.join(named)}"
        raise instrument.error(found, f"one of them as band{f' (not {show(band)})' if band else ''}")
    return instrument.need("Band_Calibration_List/Band_Calibration/Polynomial_Look_Angles")


def _written(node: Node) -> list[str]:
    """All numbers of a band's look angles, as they are written."""
    return [child.tag + (child.text or "").strip() for child in node.need("Polynomial_Look_Angles").element]


def _series(angles: Node, name: str) -> Array:
    """Coefficients NAME_0, NAME_1... of a tangent; a unit other than none would make them something else."""
    values = [angles.need(f"{name}_0")]
    while (following := angles.find(f"{name}_{len(values)}")) is not None:
        values.append(following)
    for node in values:
        node.unit({"": 1.0, "1": 1.0, "none": 1.0})
    return np.array([node.number() for node in values])
