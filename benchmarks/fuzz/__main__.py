"""Damaged files of every format, each of which must be refused in one sentence or read as what it says.

    python benchmarks/fuzz --seconds 60 --seed 1
    python benchmarks/fuzz --show "SP3" 1234 --seed 1 --out case

Needs the extras spice, gis and fast, and the tests beside it, from which the valid files come.  Cases are damaged by
what the format is made of (numbers, times, words, lines, elements, counts in binary heads) and by bytes; one in twenty
is a change that must not matter (ends of lines, comments, blanks, the same number spelt otherwise, packing).  The
outcome of each is one of: refused (one printable line of at most so many letters that names the file), accepted and
compared (with what the unchanged file gives, or with a second parser), accepted, or a fault: anything else, such as a
traceback, a warning, a line of a library on the terminal, a file left behind, 30 s, 1.2 GB, or the end of the process.
The readers run in a process of their own, which is begun again behind a case that ended it.  Exit status 1 if there is
a fault.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import re
import shutil
import sys
from collections import Counter, defaultdict
from pathlib import Path
from tempfile import TemporaryDirectory

from worker import chosen, work

KINDS = ("refused", "accepted, compared", "accepted", "fault")
MOST_SECONDS = 30.0
_TICK = os.sysconf("SC_CLK_TCK")


def cpu_seconds(pid: int) -> float:
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / _TICK


def fuzz(only: str, seed: int, seconds: float, folder: Path):
    """Counts by target and kind, and the faults (target, number, text)."""
    counts: Counter[tuple[str, str]] = Counter()
    faults: list[tuple[str, int, str]] = []
    begins: dict[str, int] = {}
    used = 0.0
    names: list[str] = []
    while used < seconds:
        said, place = folder / "said", folder / "work"
        said.write_text("")
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        process = multiprocessing.get_context("spawn").Process(
            target=work, args=(only, str(place), seed, begins, seconds - used, str(said))
        )
        process.start()
        hung = watched(process, place / "state")
        used += hung.cpu_s
        for line in said.read_text(encoding="utf-8").splitlines():
            told = json.loads(line)
            if "names" in told:
                names = told["names"]
            elif "fault" in told:
                faults.append(tuple(told["fault"]))
            else:
                counts.update({(name, kind): n for name, kind, n in told["counts"]})
                begins |= told["number"]
        if process.exitcode == 0 or hung.interrupted:
            break
        if hung.at is None:
            raise SystemExit(f"the process that reads ended with {process.exitcode} before it began")
        index, number = hung.at
        faults.append((names[index], number, f"the process ended ({process.exitcode}){hung.why}"))
        counts[names[index], "fault"] += 1
        begins[names[index]] = number + 1
    return counts, faults


class watched:
    """Wait for a process; end it where one case takes too long. ``at`` is the last case, ``why`` if it was ended.

    Ctrl-C ends it too: what was found until then counts.
    """

    def __init__(self, process, state: Path) -> None:
        self.at, self.why, self.cpu_s, self.interrupted = None, "", 0.0, False
        try:
            self._watch(process, state)
        except KeyboardInterrupt:
            self.interrupted = True
            process.kill()
            process.join()

    def _watch(self, process, state: Path) -> None:
        since = 0.0
        while process.is_alive():
            process.join(0.5)
            now = cpu_seconds(process.pid)
            self.cpu_s = max(self.cpu_s, now)
            at = self._read(state)
            if at != self.at:
                self.at, since = at, now
            elif at is not None and now - since > 3 * MOST_SECONDS:
                self.why = f", more than {MOST_SECONDS:g} s"
                process.kill()

    @staticmethod
    def _read(state: Path):
        try:
            index, number = state.read_text().split()
            return int(index), int(number)
        except (OSError, ValueError):
            return None


def table(counts) -> str:
    by_target = defaultdict(Counter)
    for (name, kind), n in counts.items():
        by_target[name][kind] += n
    lines = [f"| reader | cases | {' | '.join(KINDS)} |", "|---|" + "---|" * (len(KINDS) + 1)]
    for name, found in [*by_target.items(), ("all", sum(by_target.values(), Counter()))]:
        numbers = [sum(found.values()), *(found[kind] for kind in KINDS)]
        lines.append(f"| {name} | {' | '.join(f'{n:,}'.replace(',', ' ') for n in numbers)} |")
    return "\n".join(lines)


def summed(runs) -> Counter[tuple[str, str]]:
    counts: Counter[tuple[str, str]] = Counter()
    for run in runs:
        counts.update({(name, kind): n for name, kind, n in run["counts"]})
    return counts


def show(name: str, number: int, seed: int, out: Path) -> None:
    """Write the files of one case, and what became of it."""
    from worker import case_of, outcome, prepared

    target = chosen("")[name]
    expected = prepared(target, out)
    case = case_of(target, seed, number)
    (out / case.file).write_bytes(case.content)
    print(case.file, case.change)
    print(outcome(target, case, out, expected))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="CPU seconds")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="readers whose name has this in it")
    parser.add_argument("--show", nargs=2, metavar=("READER", "NUMBER"))
    parser.add_argument("--out", type=Path, default=Path("case"))
    parser.add_argument("--json", type=Path, help="append counts and faults to this file")
    parser.add_argument(
        "--sum", type=Path, help="print the table of all runs in such a file, and run nothing"
    )
    given = parser.parse_args()
    if given.sum:
        runs = [json.loads(line) for line in given.sum.read_text().splitlines()]
        print(table(summed(runs)))
        return
    if given.show:
        show(given.show[0], int(given.show[1]), given.seed, given.out)
        return
    memory = Path("/dev/shm")
    with TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        counts, faults = fuzz(given.only, given.seed, given.seconds, Path(folder))
    print(table(counts))
    kinds = defaultdict(list)
    for name, number, text in faults:
        kinds[name, re.sub(r"\d+|(['\"]).*?\1", "", text)[:24]].append((number, text))
    for (name, _), found in sorted(kinds.items()):
        print(f"\n{len(found)} times {name}, such as {found[0][0]}: {found[0][1]}")
    if given.json:
        rows = [[name, kind, n] for (name, kind), n in counts.items()]
        with given.json.open("a") as file:
            file.write(json.dumps({"seed": given.seed, "counts": rows, "faults": faults}) + "\n")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
