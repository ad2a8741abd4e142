"""Readers of products, ground points, rasters and vector files; made by their libraries and by the tests."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from damage import BINARY, PLAIN, TEXT, Same, respelled, xml_comment
from target import Array, Target


def _product(
    name: str, files: Mapping[str, bytes], path: str, same: tuple[Same, ...], *damaged: str
) -> Target:
    def read(folder: Path) -> Any:
        from starplumb.io.vendors.product import read_product

        return read_product(folder / path)

    return Target(name, files, damaged or (path,), read, same=same)


def _vendors() -> Iterator[Target]:
    from test_csm import scanner
    from test_digitalglobe import _parts, _pvl, _xml
    from test_dimap import delivered, production
    from test_pinhole import tsai
    from test_spot_dimap import scene

    xml = (*PLAIN[:1], *PLAIN[2:], xml_comment)
    yield _product("DIMAP, delivered", {"dim.XML": delivered().encode()}, "dim.XML", xml)
    yield _product("DIMAP, production", {"dim.XML": production().encode()}, "dim.XML", xml)
    yield _product("DIMAP, SPOT", {"METADATA.DIM": _short(scene()).encode("latin-1")}, "METADATA.DIM", xml)
    parts = _parts()
    texts = {f"scene.{suffix}": (_pvl(part) + "END;\n").encode() for suffix, part in parts.items()}
    yield _product("DigitalGlobe, text", texts, "scene.IMD", PLAIN, *texts)
    yield _product("DigitalGlobe, XML", {"scene.XML": f"<isd>{_xml(parts)}</isd>".encode()}, "scene.XML", xml)
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        state = scanner(Path(folder)).read_bytes()
        yield _product("CSM state", {"image.json": state}, "image.json", PLAIN)
        files = {
            "shot.tsai": tsai(Path(folder)).read_bytes(),
            "shot.tif": raster(np.zeros((20, 30), np.uint8)),
        }
        yield _product(".tsai", files, "shot.tsai", PLAIN)


def _short(scene: str) -> str:
    """A scene with every hundredth of its look angles, and as many columns."""
    first, *rows = scene.split("<Look_Angles><DETECTOR_ID>")
    last, end = rows[-1].split("</Look_Angles>", 1)
    kept = [row.split("</Look_Angles>", 1)[0] for row in rows[:-1:100]] + [last]
    kept = [
        f"<Look_Angles><DETECTOR_ID>{i}<{row.split('<', 1)[1]}</Look_Angles>" for i, row in enumerate(kept, 1)
    ]
    return (first + "".join(kept) + end).replace("2001", str(len(kept))).replace(">1001<", ">11<")


def raster(values: Array, **profile: Any) -> bytes:
    import warnings

    import rasterio
    from rasterio.errors import NotGeoreferencedWarning
    from rasterio.io import MemoryFile

    shape = {"width": values.shape[1], "height": values.shape[0], "count": 1, "dtype": str(values.dtype)}
    with warnings.catch_warnings(), MemoryFile() as memory:
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with memory.open(**({"driver": "GTiff"} | shape | profile)) as file:
            file.write(values, 1)
        del rasterio
        return bytes(memory.read())


def _points() -> Iterator[Target]:
    from test_points import QGIS, WGS84

    asp = "L1 45.5 9.25 100.0 0.5 0.5 0.5 scene1.tif 10.5 20.25 1.0 1.0\n"
    asp += "L2,45.6,9.3,101.5,0.5,0.5,0.5,scene1.tif,30.5,40.25,1,1\n"
    odm = "WGS84 UTM 32N\n500000.5 5050000.25 100.5 10.5 20.25 scene1.tif L1\n"
    odm += "500100.5 5050100.25 101.5 30.5 40.25 scene1.tif\n"
    place = {"type": "Point", "coordinates": [24.4, -33.6, 214.7]}
    one = {
        "type": "Feature",
        "properties": {"id": "p", "ji": [821.3, 62.3], "filename": "scene.tif"},
        "geometry": place,
    }
    geojson = json.dumps({"type": "FeatureCollection", "features": [one, one | {"id": 2}]}, indent=1)
    named = "gcp_name,image_name,im_x,im_y,geo_x,geo_y,geo_z\nL1,a.tif,10.5,20.5,500000.5,5050000.5,100.5\n"

    def of(name: str, crs: str | None = None) -> Callable[[Path], Any]:
        def read(folder: Path) -> Any:
            from starplumb.io.points.read import read_ground_points

            return read_ground_points(folder / name, crs)

        return read

    texts = {"scene.points": WGS84 + QGIS, "control.gcp": asp, "gcp_list.txt": odm, "gcps.geojson": geojson}
    for name, text in texts.items():
        yield Target(f"points {name}", {name: text.encode()}, (name,), of(name))
    yield Target(
        "points named.csv",
        {"named.csv": named.encode()},
        ("named.csv",),
        of("named.csv", "EPSG:32632"),
        same=(*PLAIN, respelled),
    )
    from rasterio.control import GroundControlPoint

    gcps = [
        GroundControlPoint(row, col, 9.0 + col, 45.0 + row, 100.0, str(row))
        for row, col in ((1, 1), (2, 4), (7, 3))
    ]
    tagged = raster(np.zeros((20, 30), np.uint8), gcps=gcps, crs="EPSG:4326")
    yield Target("points in .tif", {"image.tif": tagged}, ("image.tif",), of("image.tif"), BINARY, ())


def _rasters() -> Iterator[Target]:
    import rasterio

    heights = np.add.outer(10.0 * np.arange(8), np.arange(9.0)).astype(np.float32)
    turn = rasterio.Affine(0.01, 0.0, 9.0, 0.0, -0.01, 45.0)
    tiff = raster(heights, crs="EPSG:4326", transform=turn)
    tiles = {"tiled": True, "blockxsize": 16, "blockysize": 16, "compress": "deflate", "nodata": -9999.0}
    tiled = raster(
        heights,
        crs="EPSG:32632",
        transform=rasterio.Affine(1000.0, 0, 497_500.0, 0, -1000.0, 4.983e6),
        **tiles,
    )
    grid = "ncols 9\nnrows 8\nxllcorner 9.0\nyllcorner 44.92\ncellsize 0.01\nNODATA_value -9999\n"
    grid += "\n".join(" ".join(f"{x:.1f}" for x in row) for row in heights) + "\n"
    wkt = rasterio.crs.CRS.from_epsg(4326).to_wkt(version="WKT1_ESRI").encode()
    erdas = raster(heights, driver="HFA", crs="EPSG:4326", transform=turn)

    def of(name: str) -> Callable[[Path], Any]:
        def read(folder: Path) -> Any:
            from starplumb.io.gis.heights import surface
            from starplumb.physics.units import DEG

            ground = surface(folder / name, "ellipsoidal", None)
            latitude, longitude = np.array([44.95, 44.985]), np.array([9.03, 9.001 + 0.01])
            return ground.heights(DEG * latitude, DEG * longitude, ("L1", "L2"))

        return read

    yield Target("DEM, GeoTIFF", {"dem.tif": tiff}, ("dem.tif",), of("dem.tif"), BINARY, ())
    yield Target("DEM, GeoTIFF in tiles", {"dem.tif": tiled}, ("dem.tif",), of("dem.tif"), BINARY, ())
    files = {"dem.asc": grid.encode(), "dem.prj": wkt}
    yield Target("DEM, ASCII grid", files, ("dem.asc", "dem.prj"), of("dem.asc"), same=PLAIN[:1])
    yield Target("DEM, ERDAS", {"dem.img": erdas}, ("dem.img",), of("dem.img"), BINARY, ())


def _vectors() -> Iterator[Target]:
    from tempfile import TemporaryDirectory

    import pyogrio
    from pyogrio import raw

    del pyogrio
    wkb = np.array(
        [b"\x01\xe9\x03\x00\x00" + np.array([9.0 + i, 45.0, 100.0 + i]).tobytes() for i in range(3)],
        dtype=object,
    )
    names, sigma = np.array(["L1", "L2", "L3"], dtype=object), np.array([0.5, 0.5, 0.75])

    def of(name: str) -> Callable[[Path], Any]:
        def read(folder: Path) -> Any:
            from starplumb.io.gis.vector import read_points

            return read_points(folder / name)

        return read

    for ending, driver in ((".gpkg", "GPKG"), (".geojson", "GeoJSON"), (".shp", "ESRI Shapefile")):
        with TemporaryDirectory() as folder:
            path = Path(folder, f"marks{ending}")
            raw.write(
                path,
                wkb,
                [names, sigma],
                ["landmark_i" if ending == ".shp" else "landmark_id", "sigma_m"],
                driver=driver,
                geometry_type="Point Z",
                crs="EPSG:4326",
            )
            files = {each.name: each.read_bytes() for each in sorted(Path(folder).iterdir())}
            kinds, same = (TEXT, PLAIN[:1]) if ending == ".geojson" else (BINARY, ())
            yield Target(f"landmarks, {driver}", files, tuple(files), of(path.name), kinds, same)


def products() -> Iterator[Target]:
    """All of them."""
    yield from _vendors()
    yield from _points()
    yield from _rasters()
    yield from _vectors()
