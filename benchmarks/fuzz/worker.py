"""One process that damages files and reads them; what it is at stands in a file, in case it dies of it."""

from __future__ import annotations

import dataclasses
import gc
import json
import os
import sys
import time
import traceback
import warnings
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import second
from damage import damaged
from target import Target
from targets import targets

MOST_LETTERS = 600
"""Of a sentence, without the folder; a list of all that is wrong with a TOML file may be longer."""
MOST_LISTED = 4000
MOST_BYTES = 1_200_000_000
_PASSED_OVER = {"path", "source", "notices", "inputs", "row_number", "places", "declared", "orientation"}


class Case(NamedTuple):
    """What is written in place of one of the files, whether it must be read as before, and which change it was."""

    file: str
    content: bytes
    same: bool
    change: str


def case_of(target: Target, seed: int, number: int) -> Case:
    """The case of a number, always the same."""
    rng = np.random.default_rng([seed, zlib.crc32(target.name.encode()), number])
    file = target.damaged[rng.integers(len(target.damaged))]
    data = target.files[file]
    if target.same and rng.random() < 0.05:
        change = target.same[rng.integers(len(target.same))]
        return Case(file, change(data), True, change.__name__)
    return Case(file, damaged(rng, data, target.kinds), False, "damage")


def flat(value: Any) -> Any:
    """A value as plain data that can be compared, without what names its files."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = dataclasses.fields(value)
        return [(f.name, flat(getattr(value, f.name))) for f in fields if f.name not in _PASSED_OVER]
    if isinstance(value, np.ndarray):
        return (value.shape, value.tobytes())
    if isinstance(value, Mapping):
        return [(key, flat(item)) for key, item in value.items()]
    if isinstance(value, (str, bytes, int, float, bool, type(None))):
        return value
    if callable(value) or isinstance(value, Path):
        return None
    return [flat(item) for item in value] if hasattr(value, "__iter__") else repr(type(value))


class Reading(NamedTuple):
    """How a case ended: ``kind`` is one column of the table, ``text`` what there is to say."""

    kind: str
    text: str = ""


def outcome(target: Target, case: Case, folder: Path, expected: Any) -> Reading:
    """Read the folder of one case and judge what happens."""
    from starplumb.physics.errors import InputError

    try:
        found = target.read(folder)
    except InputError as error:
        return _refused(target, case, str(error), folder)
    except RecursionError:
        return Reading("fault", "RecursionError")
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        frames = [f"{Path(f.filename).name}:{f.lineno}" for f in traceback.extract_tb(error.__traceback__)][
            -5:
        ]
        return Reading("fault", f"{type(error).__name__}: {str(error)[:200]} ({' '.join(frames)})")
    if case.same:
        good = flat(found) == expected
        return (
            Reading("accepted, compared") if good else Reading("fault", f"{case.change} changed the values")
        )
    if target.compare is None or found is None:
        return Reading("accepted")
    try:
        target.compare(case.content, found)
    except second.Unknown:
        return Reading("accepted")
    except AssertionError as error:
        return Reading("fault", f"other values than the second parser: {' '.join(str(error).split())[:300]}")
    return Reading("accepted, compared")


def _refused(target: Target, case: Case, text: str, folder: Path) -> Reading:
    plain = text.replace(str(folder) + os.sep, "")
    most = MOST_LISTED if "problems: " in plain else MOST_LETTERS
    names = [*target.files, *(name.rpartition(".")[0] for name in target.files)]
    if case.same:
        return Reading("fault", f"{case.change} is refused: {plain[:300]}")
    if not plain.isprintable():
        return Reading("fault", f"not one printable line: {plain[:300]!r}")
    if len(plain) > most:
        return Reading("fault", f"{len(plain)} letters: {plain[:200]}")
    if not any(name in plain for name in names):
        return Reading("fault", f"names no file: {plain[:300]}")
    return Reading("refused", plain)


def prepared(target: Target, folder: Path) -> Any:
    """The valid files written, and what they are read as."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in target.files.items():
        (folder / name).write_bytes(data)
    found = target.read(folder)
    if target.compare is not None:
        target.compare(target.files[target.damaged[0]], found)
    return flat(found)


def run(
    targets: Mapping[str, Target], folder: Path, seed: int, begins: dict[str, int], until: float, state: Path
) -> Iterator[tuple[str, int, Reading]]:
    """Cases of all targets in turn, each a tenth of a second, until so much CPU time is used."""
    warnings.simplefilter("error")
    channel = _captured(folder)
    at = os.open(state, os.O_RDWR | os.O_CREAT)
    expected = {name: prepared(target, folder / str(i)) for i, (name, target) in enumerate(targets.items())}
    os.ftruncate(channel, 0)
    number, until, parent = dict(begins), time.process_time() + until, os.getppid()
    while time.process_time() < until and os.getppid() == parent:  # nobody listens any more
        for i, (name, target) in enumerate(targets.items()):
            start = time.process_time()
            while time.process_time() - start < 0.1:
                n = number.get(name, 0)
                number[name] = n + 1
                os.pwrite(at, f"{i} {n}\n".ljust(40).encode(), 0)
                yield (
                    name,
                    n,
                    _tried(target, folder / str(i), case_of(target, seed, n), expected[name], channel),
                )
        gc.collect()


def _tried(target: Target, folder: Path, case: Case, expected: Any, channel: int) -> Reading:
    (folder / case.file).write_bytes(case.content)
    begin = time.process_time()
    reading = outcome(target, case, folder, expected)
    seconds = time.process_time() - begin
    (folder / case.file).write_bytes(target.files[case.file])
    for beside in folder.iterdir():
        if beside.name not in target.files:
            beside.unlink()
            reading = Reading("fault", f"left {beside.name} behind")
    sys.stderr.flush()
    if size := os.fstat(channel).st_size:
        said = os.pread(channel, 300, 0).decode("utf-8", "replace")
        os.ftruncate(channel, 0)
        os.lseek(channel, 0, os.SEEK_SET)
        reading = Reading("fault", f"{size} bytes on the terminal: {said!r}")
    if seconds > 30.0:
        reading = Reading("fault", f"{seconds:.0f} s")
    if _most_bytes() > MOST_BYTES:
        reading = Reading("fault", f"{_most_bytes() / 1e9:.1f} GB")
        Path("/proc/self/clear_refs").write_text("5")
    return reading


def _most_bytes() -> int:
    text = Path("/proc/self/status").read_bytes()
    start = text.index(b"VmHWM:") + 6
    return 1024 * int(text[start : text.index(b"kB", start)])


def _captured(folder: Path) -> int:
    """Standard output and error of this process, libraries included, into a file."""
    channel = os.open(folder / "terminal", os.O_RDWR | os.O_CREAT | os.O_APPEND)
    os.dup2(channel, 1)
    os.dup2(channel, 2)
    return channel


def chosen(only: str) -> dict[str, Target]:
    """The readers whose name has this in it."""
    return {name: target for name, target in targets().items() if only.lower() in name.lower()}


def work(only: str, folder: str, seed: int, begins: dict[str, int], until: float, said: str) -> None:
    """The process that reads: counts and faults to the file ``said``."""
    every = chosen(only)
    with Path(said).open("a", encoding="utf-8", buffering=1) as file:
        file.write(json.dumps({"names": list(every)}) + "\n")
        counts: Counter[tuple[str, str]] = Counter()
        number: dict[str, int] = {}
        last = time.process_time()

        def tell() -> None:
            rows = [[name, kind, n] for (name, kind), n in counts.items()]
            file.write(json.dumps({"counts": rows, "number": number}) + "\n")
            counts.clear()

        for name, n, reading in run(every, Path(folder), seed, begins, until, Path(folder, "state")):
            counts[name, reading.kind] += 1
            number[name] = n + 1
            if reading.kind == "fault":
                file.write(json.dumps({"fault": [name, n, reading.text]}) + "\n")
            if reading.kind == "fault" or time.process_time() - last > 0.5:
                tell()
                last = time.process_time()
        tell()
