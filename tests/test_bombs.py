"""Files that are small, or of one byte again and again, and would fill the memory: refused below 1.2 GB."""

from __future__ import annotations

import gzip
import json
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import pytest

from starplumb.io.text.files import read_bytes, read_text
from starplumb.io.text.json_node import JsonNode
from starplumb.io.text.xml_tree import parse_xml
from starplumb.physics.errors import InputError

MOST_BYTES = 1_200_000_000
READ = """
import json, resource, sys
from pathlib import Path
folder = Path(sys.argv[1])

def toml(path):
    import starplumb as sp
    sp.read_campaign(path)

def result(path):
    from starplumb.documents.result import ResultDocument
    from starplumb.io.text.files import read_text
    ResultDocument.from_json(read_text(path), str(path))

def orbit(path):
    from starplumb.io.formats.registry import ORBITS, Asked, recognised
    recognised(path, ORBITS).read(path, Asked(None))

def product(path):
    from starplumb.io.vendors.product import read_product
    read_product(path)

def points(path):
    from starplumb.io.points.read import read_ground_points
    read_ground_points(path, None)

def table(path):
    from starplumb.io.tables.read import read_table
    read_table(path, texts=("image_id",), numbers=("column_px",))

def orientation(path):
    from starplumb.physics.orientation import EarthOrientation
    EarthOrientation.load(path)

def png(path):
    from starplumb.io.imagery.rasters import open_pixels
    open_pixels(path, 1).cells(0, 0, 1, 1)

from starplumb.physics.errors import InputError
for name, reader in json.loads(sys.argv[2]):
    try:
        globals()[reader](folder / name)
        said = "accepted"
    except InputError as error:
        said = str(error)
    print(json.dumps([name, said, 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss]), flush=True)
"""


def packed(piece: bytes, size: int, head: bytes = b"", tail: bytes = b"") -> bytes:
    """``size`` bytes of a piece again and again as gzip; a block is packed once, as flushed blocks may be repeated."""
    block = piece * (1_000_000 // len(piece))
    times = size // len(block)
    press = zlib.compressobj(1, zlib.DEFLATED, 31)
    first = press.compress(head) + press.flush(zlib.Z_FULL_FLUSH)
    again = press.compress(block) + press.flush(zlib.Z_FULL_FLUSH)
    checksum = zlib.crc32(head)
    for _ in range(times):
        checksum = zlib.crc32(block, checksum)
    trailer = struct.pack(
        "<II", zlib.crc32(tail, checksum), len(head) + times * len(block) + len(tail) & 0xFFFFFFFF
    )
    return b"".join([first, again * times, press.compress(tail), press.flush()[:-8], trailer])


def empty_png(columns: int, rows: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", columns, rows, 8, 0, 0, 0, 0)
    rest = chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + rest


def sparse(path: Path, head: bytes, size: int) -> None:
    with path.open("wb") as file:
        file.write(head)
        file.truncate(size)


OEM = b"CCSDS_OEM_VERS = 2.0\n"
MOST = 99_000_000


@pytest.mark.slow
def test_files_that_would_fill_the_memory_are_refused_in_a_sentence(tmp_path):
    """In a process of their own, whose largest memory is told behind each."""
    pa = pytest.importorskip("pyarrow", reason="needs the extra fast")
    from pyarrow import parquet

    ones = pa.DictionaryArray.from_arrays(pa.array([0] * 30_000_000, pa.int8()), pa.array(["a"]))
    zeros = pa.array([0.0]).take(pa.array([0] * 30_000_000, pa.int32()))
    parquet.write_table(pa.table({"image_id": ones, "column_px": zeros}), tmp_path / "rows.parquet")
    long = pa.DictionaryArray.from_arrays(pa.array([0] * 1_000_000, pa.int8()), pa.array(["a" * 2_000]))
    texts = pa.table({"image_id": long, "column_px": zeros[:1_000_000]})
    parquet.write_table(texts, tmp_path / "texts.parquet")
    packing = pa.ipc.IpcWriteOptions(compression="zstd")
    for name, made, content in (
        ("texts.arrow", pa.ipc.new_file, texts),
        ("rows.arrow", pa.ipc.new_file, pa.table({"image_id": ones, "column_px": zeros, "row_px": zeros})),
        ("rows.stream", pa.ipc.new_stream, pa.table({"image_id": ones, "column_px": zeros, "row_px": zeros})),
    ):
        with made(tmp_path / name, content.schema, options=packing) as writer:
            writer.write_table(content)
    sparse(tmp_path / "campaign.toml", b"[campaign]\n", 8 << 30)
    sparse(tmp_path / "orbit.oem", OEM, 8 << 30)
    sparse(tmp_path / "finals.all", b" ", 8 << 30)
    sparse(tmp_path / "points.csv", b"image_id,column_px\n", 8 << 30)
    (tmp_path / "large.png").write_bytes(empty_png(200_000, 200_000))
    bombs = {
        "lines.oem": packed(b"\n", MOST, OEM),
        "wide.oem": packed(b"x", MOST, OEM + "\U0001f6f0\n".encode()),
        "more.oem": packed(b"x", 3_000_000_000, OEM),
        "tags.xml": packed(b"<a/>", MOST, b"<isd>", b"</isd>"),
        "tags.json": packed(b"[],", MOST, b'{"schema": "starplumb-result/1", "images": [', b"0]}"),
        "values.json": packed(b"0,", 2_000_000, b'{"schema": "starplumb-result/1", "images": [', b"0]}"),
        "keys.toml": packed(b"a.b=1\n", MOST),
        "parts.toml": b"a" + b".a" * 1_900_000 + b"=1\n",
        "many.toml": b"[camera]\n" + b"".join(b"k%d=1\n" % i for i in range(300_000)),
        "values.IMD": packed(b"a=1;", MOST),
        "points.geojson": packed(b"{},", MOST, b'{"type": "FeatureCollection", "features": [', b"{}]}"),
    }
    for name, data in bombs.items():
        (tmp_path / name).write_bytes(data)
    readers = [
        *(
            ("campaign.toml", "toml"),
            ("keys.toml", "toml"),
            ("orbit.oem", "orbit"),
            ("finals.all", "orientation"),
        ),
        *(("lines.oem", "orbit"), ("wide.oem", "orbit"), ("more.oem", "orbit"), ("tags.xml", "product")),
        *(("tags.json", "result"), ("values.json", "result"), ("values.IMD", "product")),
        *(
            ("points.geojson", "points"),
            ("rows.parquet", "table"),
            ("large.png", "png"),
            ("points.csv", "table"),
        ),
        *(
            ("texts.parquet", "table"),
            ("texts.arrow", "table"),
            ("rows.arrow", "table"),
            ("rows.stream", "table"),
        ),
        *(("parts.toml", "toml"), ("many.toml", "toml")),
    ]
    done = subprocess.run(
        [sys.executable, "-c", READ, str(tmp_path), json.dumps(readers)],
        capture_output=True,
        text=True,
        check=False,
    )
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(told) == len(readers), done.stderr[-2000:]
    for name, said, _ in told:
        assert said.startswith(f"{tmp_path / name}"), (name, said)
        assert ": found " in said
        assert "wanted" in said
        assert len(said) < 600 + len(str(tmp_path))
    assert [(name, size) for name, _, size in told if size > MOST_BYTES] == []


def test_more_bytes_lines_elements_or_values_than_any_file_has_are_refused(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(gzip.compress(b"x" * 2_000))
    assert len(read_bytes(path, 2_000)) == 2_000
    with pytest.raises(InputError, match=r"found a packed file of more than 1,999 bytes"):
        read_bytes(path, 1_999)
    path.write_bytes(b"x" * 2_000)
    with pytest.raises(InputError, match=r"found 2,000 bytes, wanted at most 1,999"):
        read_bytes(path, 1_999)
    path.write_bytes(b"x\n" * 5)
    assert read_text(path, 20, 5).count("\n") == 5
    with pytest.raises(InputError, match=r"found more than 4 lines"):
        read_text(path, 20, 4)
    with pytest.raises(InputError, match=r"more than 3,000,000 values"):
        JsonNode.of(path, '{"a": [' + "0," * 3_000_000 + "0]}")
    with pytest.raises(InputError, match=r"found more than 3,000,000 elements"):
        parse_xml("a.xml", b"<a>" + b"<b/>" * 6_000_001 + b"</a>")
