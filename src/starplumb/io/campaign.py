"""A campaign from its folder: ``campaign.toml`` and the files it names, checked and brought inside as
physics."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from starplumb import so3
from starplumb.campaign import Campaign, Detections, Sightings
from starplumb.corrections import Corrections
from starplumb.errors import InputError
from starplumb.orientation import EarthOrientation
from starplumb.units import ARCSEC, DEG

from . import markers, motion
from .camera import pixel_shift, read_camera
from .config import CAMERA, CampaignConfig, Mounting
from .files import fingerprint, trouble
from .tables import Array, Epochs
from .toml import check, read_toml, refuse

_EXACT = 1e-6
"""A matrix this near to orthonormal is taken as a rotation written with its digits; beyond it a notice says
so."""


@dataclass(frozen=True)
class LoadedCampaign:
    """A campaign with what it was read from.

    ``inputs`` maps each file, as the campaign names it, to its SHA-256; ``notices`` are sentences the user
    should see; ``orientation`` is that of the Earth where an inertial frame asked for it (its ``source``
    names the table). ``detections`` stand in for the sightings, of which there are then none, where the
    landmarks are not known.
    """

    campaign: Campaign
    config: CampaignConfig
    inputs: dict[str, str]
    notices: tuple[str, ...]
    orientation: EarthOrientation | None
    detections: Detections | None = None

    @property
    def predicted_orientation(self) -> bool:
        """Whether the Earth's orientation at an image is predicted rather than measured."""
        return self.orientation is not None and bool(
            np.any(self.orientation.predicted(self.campaign.images.t_ns))
        )

    @property
    def C_EK_true(self) -> Array | None:
        """The true mounting where the campaign is simulated and says so."""
        truth = self.config.truth
        return None if truth is None else so3.from_quaternion(truth.quaternion_xyzw)

    @property
    def shift_px(self) -> float:
        """What the user's pixel coordinates are ahead of ours: 0.5 where (0, 0) is a corner."""
        return pixel_shift(self.config.camera)


def load_campaign(path: Path, *, with_detections: bool = False) -> LoadedCampaign:
    """Read ``campaign.toml`` at ``path`` and every file it names, which stand relative to its folder.

    ``with_detections`` says that the caller can do without known landmarks; a campaign with [detections] is
    else refused. Raises InputError, one sentence, for the first file that cannot be used.
    """
    config = check(read_toml(path), CampaignConfig, path)
    files = _locate(config, path)
    if config.detections is not None and not with_detections:
        raise InputError(
            f"{path}: detections: found marker images whose landmarks are not known, wanted [observations]: "
            "label the detections first"
        )
    notices: list[str] = []
    orientation = _orientation(config, files)
    campaign, detections = _assemble(config, files, orientation, notices, path)
    inputs = {"campaign.toml": fingerprint(path)}
    for key, name in _named(config).items():
        inputs |= _fingerprints(name, files[key])
    return LoadedCampaign(campaign, config, inputs, tuple(notices), orientation, detections)


def model_mounting(config: Mounting) -> Array:
    """C_EK of the [mounting] section, whichever way it is written and whichever direction it has."""
    if config.quaternion_xyzw is not None:
        C = so3.from_quaternion(config.quaternion_xyzw)
    elif config.quaternion_wxyz is not None:
        C = so3.from_quaternion(np.roll(config.quaternion_wxyz, -1))
    elif config.matrix is not None:
        C = so3.nearest(config.matrix)
    elif config.rotation_vector_deg is not None:
        C = so3.exp(DEG * np.array(config.rotation_vector_deg))
    elif config.euler_deg is not None and config.euler_order is not None:
        C = _from_euler(config.euler_deg, config.euler_order)
    else:
        raise ValueError("the mounting states no rotation")
    return C if config.source == CAMERA else C.mT


def _from_euler(angles_deg: tuple[float, ...], order: str) -> Array:
    """Product of the three turns, in the order written about turned axes (capitals), else about fixed
    ones."""
    axes = np.eye(3)
    turns = [
        so3.exp(a * DEG * axes["xyz".index(axis)]) for a, axis in zip(angles_deg, order.lower(), strict=True)
    ]
    first, second, third = turns if order.isupper() else reversed(turns)
    return np.asarray(first @ second @ third)


def _named(config: CampaignConfig) -> dict[str, str]:
    """Key and name of every file of the campaign."""
    named = {
        "ephemeris.file": config.ephemeris.file,
        "attitude.file": config.attitude.file,
        "landmarks.file": config.landmarks.file,
        "images.file": config.images.file,
    }
    optional = {
        "camera.look_angles": config.camera.look_angles,
        "observations.file": config.observations and config.observations.file,
        "detections.file": config.detections and config.detections.file,
        "earth.orientation_file": config.earth and config.earth.orientation_file,
    }
    return named | {key: name for key, name in optional.items() if name}


def _locate(config: CampaignConfig, path: Path) -> dict[str, Path]:
    """Where each named file is. Raises InputError that lists all those that cannot be opened."""
    files = {key: path.parent / name for key, name in _named(config).items()}
    faults = {key: trouble(place) for key, place in files.items()}
    problems = [f"{key}: {files[key]}: {fault}" for key, fault in faults.items() if fault]
    if problems:
        raise refuse(path, problems)
    return files


def _fingerprints(name: str, place: Path) -> dict[str, str]:
    """Digest of a file, and of those that belong to it: a shapefile keeps its attributes in a second one."""
    parts = {Path(name).with_suffix(end).as_posix(): place.with_suffix(end) for end in (".dbf", ".prj")}
    beside = {key: part for key, part in parts.items() if place.suffix.lower() == ".shp" and part.is_file()}
    return {key: fingerprint(part) for key, part in ({name: place} | beside).items()}


def _orientation(config: CampaignConfig, files: dict[str, Path]) -> EarthOrientation | None:
    """The Earth's orientation where a frame of the campaign is inertial."""
    frames = (config.ephemeris.frame, config.attitude.source, config.attitude.target)
    return EarthOrientation.load(files.get("earth.orientation_file")) if "GCRF" in frames else None


def _assemble(
    config: CampaignConfig,
    files: dict[str, Path],
    orientation: EarthOrientation | None,
    notices: list[str],
    path: Path,
) -> tuple[Campaign, Detections | None]:
    scale = config.campaign.time_scale
    camera = read_camera(config.camera, files.get("camera.look_angles"), notices)
    images = markers.read_images(files["images.file"], scale, camera.scans, notices)
    landmarks = markers.read_landmarks(files["landmarks.file"], notices)
    grid = markers.Grid(*camera.size_px, shift_px=pixel_shift(config.camera))
    sightings, detections = _no_sightings(), None
    if "observations.file" in files:
        sightings = markers.read_observations(
            files["observations.file"], images.ids, landmarks.ids, grid, notices
        )
    else:
        detections = markers.read_detections(files["detections.file"], images.ids, grid, notices)
    ephemeris = motion.read_ephemeris(
        files["ephemeris.file"], config.ephemeris, scale, images.t_ns, orientation, notices
    )
    samples = motion.read_attitude(files["attitude.file"], config.attitude, scale, notices)
    notices += _rounded(config.mounting, path)
    if config.earth is not None and orientation is None:
        notices.append(
            f"{path}: earth.orientation_file is not used, since no frame of the campaign is inertial"
        )
    prior, switches = config.mounting.sigma_arcsec, config.corrections
    campaign = Campaign(
        name=config.campaign.name,
        camera=camera,
        C_EK=model_mounting(config.mounting),
        sigma_mounting=None if prior is None else ARCSEC * np.array(prior),
        ephemeris=ephemeris,
        sigma_position=np.array(config.ephemeris.sigma_m),
        position_frame=config.ephemeris.frame,
        attitude=motion.attitude_series(samples, config.attitude, orientation),
        cov_attitude_E=_cov_attitude(config, samples, images.t_ns, notices, path),
        landmarks=landmarks,
        images=images,
        sightings=sightings,
        corrections=Corrections(switches.light_time, switches.aberration, switches.refraction),
        orientation=orientation,
    )
    return campaign, detections


def _no_sightings() -> Sightings:
    index, value = np.empty(0, dtype=np.int64), np.empty(0)
    return Sightings(index, index, value, value, value, np.empty(0, dtype=np.bool_))


def _cov_attitude(
    config: CampaignConfig, samples: motion.AttitudeSamples, t_ns: Epochs, notices: list[str], path: Path
) -> Array:
    """From the table's own sigmas at the images, else the campaign's; one of them must be stated."""
    stated, own = config.attitude.sigma_arcsec, motion.sigma_at(samples, t_ns)
    if own is None and stated is None:
        raise InputError(
            f"{path}: attitude.sigma_arcsec: missing, wanted one number or three, which the solution needs "
            f"(or the columns {', '.join(motion.SIGMA_ATTITUDE)} in {config.attitude.file})"
        )
    if own is not None and stated is not None:
        notices.append(f"{path}: attitude.sigma_arcsec gives way to the sigmas in {config.attitude.file}")
    sigma = own if own is not None else ARCSEC * np.array(stated)
    return sigma[..., None] ** 2 * np.eye(3)


def _rounded(config: Mounting, path: Path) -> list[str]:
    """A notice where the written matrix is orthonormal to few digits only."""
    if config.matrix is None:
        return []
    C = np.array(config.matrix)
    off = float(np.abs(C @ C.mT - np.eye(3)).max())
    if off <= _EXACT:
        return []
    return [f"{path}: mounting.matrix is orthonormal to {off:.1g} only; the nearest rotation is taken"]
