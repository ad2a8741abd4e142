"""Which files of a delivery describe an image, and whose product they are of: told by their first lines."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from ...physics.errors import InputError
from ..text.files import MOST_TEXT, read_beginning, show, trouble

Vendor = Literal["DIMAP", "DigitalGlobe", "CSM", "pinhole"]
DIGITALGLOBE = (".imd", ".att", ".eph", ".geo")
"""Endings of DigitalGlobe's text files; the first describes the image."""
_ROOT = re.compile(r"<(\w+)[\s>]")
_SENSOR_MODEL = re.compile(r'USGS_ASTRO_\w+_SENSOR_MODEL\b|\{\s*"')
"""A model state, or the JSON of one or of an ISD."""
_PINHOLE = re.compile(r'VERSION_\d+\s+PINHOLE\b|\{(?=[\s\S]*"P_intrinsic")')
"""A .tsai, or the JSON of a SkySat frame."""
_MOST_DEEP = 3
"""Folders below the one that is named: a volume, a product in it, an image in that."""


def vendor_of(path: Path) -> Vendor:
    """Whose metadata a file is. Raises InputError for any other file."""
    if path.suffix.lower() in DIGITALGLOBE:
        return "DigitalGlobe"
    if _PINHOLE.match(_start(path)):
        return "pinhole"
    if _SENSOR_MODEL.match(_start(path)):
        return "CSM"
    root = _root(path)
    if root == "isd":
        return "DigitalGlobe"
    if root is not None and root.endswith("dimap_document"):
        return "DIMAP"
    if (fault := trouble(path)) is not None:
        raise InputError(f"{path}: {fault}")
    found = f"the ending {show(path.suffix)}" if root is None else f"the XML element {show(root)}"
    files = ", ".join(DIGITALGLOBE)
    wanted = f"DIMAP (Dimap_Document) or DigitalGlobe (isd) as XML, {files}, or a sensor model (CSM, .tsai)"
    raise InputError(f"{path}: found {found}, wanted {wanted}")


def _root(path: Path) -> str | None:
    """The name of the root element of an XML file, None for other files."""
    start = _start(path)
    found = _ROOT.search(start) if start.startswith("<") else None
    return None if found is None else found[1].lower()


def _start(path: Path) -> str:
    return read_beginning(path).decode("utf-8", "replace").lstrip("\ufeff \t\r\n")


def one_metadata_file(path: Path) -> Path:
    """The one file of a folder that describes an image, or the file itself."""
    if not path.is_dir():
        return path
    found = metadata_files(path)
    if not found:
        raise InputError(
            f"{path}: found a folder without .IMD, and without .XML or .DIM that has a sensor model, wanted the "
            "metadata of an image in the geometry of its sensor"
        )
    if len(found) > 1:
        names = show([file.relative_to(path).as_posix() for file in found])
        raise InputError(f"{path}: found {len(found)} files of images, {names}, wanted the one to import")
    return found[0]


def metadata_files(folder: Path) -> list[Path]:
    """The files in a folder, and in the folders in it, that describe an image each.

    Of an .IMD and an XML file of one name, which say the same, the .IMD is taken where .ATT and .EPH are beside it.
    """
    every = _files(folder, _MOST_DEEP)
    named = {(file.with_suffix("").as_posix().lower(), file.suffix.lower()): file for file in every}
    images: dict[str, Path] = {}
    for (stem, suffix), file in named.items():
        whole = suffix == ".imd" and {(stem, ".att"), (stem, ".eph")} <= named.keys()
        if whole or (suffix in (".xml", ".dim") and stem not in images and _describes_an_image(file)):
            images[stem] = file
    return list(images.values()) or [file for (_, suffix), file in named.items() if suffix == ".imd"]


def _files(folder: Path, deep: int) -> Iterator[Path]:
    """The files in a folder and, ``deep`` levels down, in those in it, in the order of their names."""
    for entry in sorted(folder.iterdir()):
        if entry.is_file():
            yield entry
        elif deep and entry.is_dir():
            yield from _files(entry, deep - 1)


def _describes_an_image(path: Path) -> bool:
    """Whether an XML file has a sensor model: a delivery also has those of volumes, RPC, masks and processing."""
    root = _root(path)
    if root is None or not (root == "isd" or root.endswith("dimap_document")):
        return False
    if path.stat().st_size > MOST_TEXT:  # told in a sentence where it is read
        return True
    data = path.read_bytes()
    models = (b"Refined_Model>", b"Sensor_Model_Characteristics>", b"Instrument_Look_Angles", b"EPHEMLIST")
    return any(word in data for word in models)
