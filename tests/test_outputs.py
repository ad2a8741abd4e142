"""Where every command writes, and what it says where it cannot: the table below names them all."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from typer.core import TyperGroup

from command import Spoken, demo, starplumb
from starplumb.cli.channels import Commands, Interrupted
from starplumb.disk.interruption import Stopped
from starplumb.disk.publish import publish
from starplumb.io.gis.geopackage import write_residuals
from starplumb.io.text.files import trouble
from starplumb.io.text.visible import visible
from starplumb.physics.errors import InputError
from starplumb.report.charts.chart import Axis, Chart
from starplumb.report.charts.library import figure_of
from starplumb.report.charts.vector import standalone
from test_docs import COMMANDS
from test_pinhole import image, tsai

FOREIGN = "a user's own\n"


def renamed(folder, table, name):
    """A campaign that reads a table under the name of an output; both paths."""
    path = folder / "campaign.toml"
    (folder / table).rename(folder / name)
    path.write_text(path.read_text(encoding="utf-8").replace(table, name), encoding="utf-8")
    return path, folder / name


def over_observations(folder):
    path, read = renamed(folder, "observations.csv", "residuals.csv")
    return ["calibrate", path, "--out", folder], read


def over_the_prior(folder):
    path = folder / "campaign.toml"
    assert starplumb("calibrate", path, "--no-report", "-q", "-m", "gls").status == 0
    return [
        "calibrate",
        path,
        "--prior",
        folder / "result" / "result.json",
    ], folder / "result" / "result.json"


def over_the_campaign(folder):
    path = (folder / "campaign.toml").rename(folder / "compare.json")
    return ["compare", path, "--out", folder], path


def over_landmarks(folder):
    path, read = renamed(folder, "landmarks.csv", "pixels.csv")
    return ["project", path, "--out", folder], read


def over_the_result(folder):
    path = folder / "campaign.toml"
    assert starplumb("calibrate", path, "--no-report", "-q", "-m", "gls").status == 0
    read = (folder / "result" / "result.json").rename(folder / "ground.npy")
    grid = ["--grid", read, "--every", 6000]
    return ["locate", path, "--image", "image01", "--result", read, *grid], read


def over_points(folder):
    read = (folder / "landmarks.csv").rename(folder / "other.csv")
    (folder / "landmarks.csv").hardlink_to(read)
    read.write_text(
        "image_id,landmark_id,latitude_deg,longitude_deg,height_m,column_px,row_px\na,b,1,2,3,4,5\n",
        encoding="utf-8",
    )
    return ["points", read, "--out", folder, "--sigma-m", 1, "--sigma-px", 1], read


def over_a_scenario(command, name):
    def made(folder):
        assert starplumb("init", folder / "s", "--scenario", "two-images", "-q").status == 0
        read = (folder / "s" / "scenario.toml").rename(folder / "s" / name)
        more = ["--trials", 10, "--workers", 1] if command == "simulate" else []
        return [command, read, "--out", folder / "s", *more], read

    return made


def over_something(name, *command):
    def made(folder):
        (folder / name).write_text(FOREIGN, encoding="utf-8")
        return [*command, "--out", folder], folder / name

    return made


def over_a_folder(folder):
    return ["init", folder], folder / "campaign.toml"


def over_a_table(folder):
    (folder / "new").mkdir()
    (folder / "new" / "ephemeris.csv").write_text(FOREIGN, encoding="utf-8")
    image(folder, "shot.tif")
    product = [tsai(folder), folder / "new", "--sigma-m", 1, "--sigma-arcsec", 1]
    return ["import", *product], folder / "new" / "ephemeris.csv"


def over_an_archive(folder):
    (folder / "m.db").write_text(FOREIGN, encoding="utf-8")
    return ["archive", "init", folder / "m.db"], folder / "m.db"


def of_an_archive(name, *command):
    def made(folder):
        assert starplumb("archive", "init", folder / "m.db", "-q").status == 0
        (folder / name).write_text(FOREIGN, encoding="utf-8")
        return ["archive", command[0], folder / "m.db", *command[1:], "--out", folder], folder / name

    return made


def over_the_measured(folder):
    return ["measure", folder / "campaign.toml", "--out", folder], folder / "campaign.toml"


WRITING = {
    "measure": [over_the_measured],
    "calibrate": [
        over_observations,
        over_the_prior,
        over_something("report.html", "calibrate", "campaign.toml"),
    ],
    "compare": [over_the_campaign],
    "project": [over_landmarks, over_something("pixels.csv", "project", "campaign.toml")],
    "locate": [over_the_result],
    "points": [over_points],
    "simulate": [over_a_scenario("simulate", "report.html"), over_a_scenario("simulate", "samples.parquet")],
    "budget": [
        over_a_scenario("budget", "report.html"),
        over_something("report.html", "budget", "two-images"),
    ],
    "plan": [
        over_a_scenario("plan", "plan.csv"),
        over_something("plan.html", "plan", "cubesat-6u", "-n", 2),
    ],
    "reproduce": [over_something("reproduce.json", "reproduce", "table1", "--trials", 10)],
    "init": [over_a_folder],
    "import": [over_a_table],
    "archive init": [over_an_archive],
    "archive trend": [of_an_archive("trend.html", "trend")],
    "archive issue": [of_an_archive("mounting.tf", "issue", "--reason", "x")],
}
READING = {"check", "diagnose", "predict", "schema", "archive list", "archive show", "archive verify"}
ADDING = {"archive add", "archive event", "archive merge", "archive rerun", "archive withdraw"}
"""They change the archive that they are given, and write nothing else."""
OUTPUTS = {"out", "grid", "into"}


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    return demo(tmp_path_factory.mktemp("example") / "demo", "--images", 3).parent


def test_every_command_stands_in_the_table():
    assert set(COMMANDS) == set(WRITING) | READING | ADDING
    with_output = {name for name, command in COMMANDS.items() if OUTPUTS & {p.name for p in command.params}}
    assert with_output <= set(WRITING)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Dataset has no geotransform")
@pytest.mark.parametrize("case", [case for cases in WRITING.values() for case in cases])
def test_no_command_replaces_what_it_reads_or_has_not_written(example, tmp_path, monkeypatch, case):
    folder = tmp_path / "work"
    copytree(example, folder)
    monkeypatch.chdir(folder)
    command, read = case(folder)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    refused = starplumb(*command)
    assert refused.status == 2
    assert refused.err.count("\n") == 1
    assert read.name in refused.err or command[0] in ("init", "points")
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


HOSTILE = "\x1b]0;title\x07\x1b[31m\u9752\u68ee\x9b2J\u202e$<b>"
"""A window's title, red, Chinese, clear the screen, right to left, mathematics, a tag."""


def obeyed(text):
    return sorted(set(text) & set("\x1b\x07\x9b\u202e"))


def test_names_that_a_terminal_would_obey_are_written_out(example, tmp_path):
    folder = tmp_path / "work"
    copytree(example, folder)
    for name in ("images.csv", "observations.csv"):
        path = folder / name
        path.write_text(path.read_text(encoding="utf-8").replace("image01", HOSTILE), encoding="utf-8")
    for command in (["check"], ["calibrate", "--no-report"], ["locate", "--image", HOSTILE + "x", 1, 1]):
        spoken = starplumb(command[0], folder / "campaign.toml", *command[1:])
        assert obeyed(spoken.out + spoken.err) == []
        said = starplumb(command[0], folder / "campaign.toml", *command[1:], "--json")
        assert obeyed(said.out) == []
    assert r"\x1b[31m青森\x9b2J\u202e$<b>" in said.err
    assert visible("tab\tand\nline, é, 青森") == "tab\tand\nline, é, 青森"


def test_a_figure_shows_any_name_without_a_warning():
    chart = Chart(Axis("", 0.0, 1.0), Axis("", 0.0, 1.0), (), title=HOSTILE)
    text = standalone((chart,), "one")
    assert obeyed(text) == []
    assert "青森" in text
    assert figure_of((chart,)).axes[0].get_title() == HOSTILE


@pytest.mark.parametrize("name", ["pipe", "zero", "folder", "nothing"])
def test_what_is_no_file_is_told_before_it_is_opened(tmp_path, name):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zero").symlink_to("/dev/zero")
    (tmp_path / "folder").mkdir()
    found = {"pipe": "a pipe", "zero": "a device", "folder": "a folder", "nothing": "no such file"}[name]
    assert f"found {found}, wanted a" in str(trouble(tmp_path / name))
    if name in ("pipe", "zero"):
        for command in (["check", tmp_path / name], ["budget", tmp_path / name]):
            spoken = starplumb(*command)
            assert spoken.status == 2
            assert f"{name}: found {found}, wanted a file" in spoken.err


def shell(command, cwd):
    """A line of a shell in which ``starplumb`` is this one."""
    run = f"{sys.executable} -c 'from starplumb.cli import main; main()'"
    done = subprocess.run(
        ["bash", "-c", command.replace("starplumb", run)], capture_output=True, cwd=cwd, check=False
    )
    return Spoken(done.returncode, done.stdout.decode(), done.stderr.decode())


FULL = "starplumb: standard output: found no way to write there (No space left on device), wanted one that takes all\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a disk that is always full")
def test_a_full_output_is_one_sentence(example):
    assert shell("starplumb --version > /dev/full", example) == Spoken(2, "", FULL)


@pytest.mark.parametrize(
    ("command", "status"),
    [("starplumb --version", 0), ("PYTHONUNBUFFERED=1 starplumb --help", 0), ("starplumb nothing", 2)],
)
def test_a_reader_that_has_gone_is_no_error(tmp_path, command, status):
    gone = "mkfifo p; exec 8<> p 9> p 8<&-; {} >&9 2>&9; echo $?"
    assert shell(gone.format(command), tmp_path) == Spoken(0, f"{status}\n", "")


@pytest.mark.slow
def test_every_kind_of_output_may_lose_its_reader(example):
    gone = "mkfifo p; exec 8<> p 9> p 8<&-; "
    commands = (
        "check campaign.toml",
        "project campaign.toml",
        "calibrate campaign.toml",
        "check campaign.toml --json",
    )
    each = "; ".join(f"starplumb {command} >&9 2>&9; echo $?" for command in commands)
    assert shell(gone + each + "; ls result/result.json", example).out == "0\n" * 4 + "result/result.json\n"


@pytest.mark.slow
def test_output_that_is_closed_full_or_narrow(example):
    assert shell("starplumb check campaign.toml --json > /dev/full", example) == Spoken(2, "", FULL)
    assert shell("starplumb check nothing.toml 2> /dev/full", example) == Spoken(2, "", "")
    closed = shell(
        "starplumb calibrate campaign.toml --no-report >&- 2>&- <&-; grep -c schema result/result.json",
        example,
    )
    assert closed == Spoken(0, "1\n", "")
    narrow = shell("PYTHONIOENCODING=ascii starplumb check campaign.toml", example)
    assert (narrow.status, narrow.err) == (0, "")
    assert narrow.out.isascii()


@pytest.mark.parametrize(("asked", "number"), [(Stopped(15), 15), (KeyboardInterrupt(), 2)])
@pytest.mark.parametrize("stage", ["make_context", "invoke"])
def test_a_command_that_is_asked_to_stop_says_so_from_its_first_step(monkeypatch, asked, number, stage):
    """typer would end with 130 and no word, whatever the signal."""

    def stopped(*of, **named):
        raise asked

    monkeypatch.setattr(TyperGroup, stage, stopped)
    with pytest.raises(Interrupted) as error:
        getattr(Commands(name="starplumb"), stage)("starplumb")
    assert error.value.number == number


def test_no_memory_left_is_a_sentence(monkeypatch):
    def full(*of, **named):
        raise MemoryError

    monkeypatch.setattr(TyperGroup, "invoke", full)
    done = starplumb("schema", "campaign")
    assert (done.status, done.out) == (2, "")
    assert (
        done.err
        == "starplumb: found no memory left for this, wanted more of it, or less to be done at once\n"
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_study_that_is_asked_to_stop_keeps_its_chunks(tmp_path, name):
    number = getattr(signal, name)
    run = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    run += "from starplumb.cli import main; main()"
    command = [
        "simulate",
        "two-images",
        "--trials",
        "2000000",
        "--chunk",
        "64",
        "--workers",
        "1",
        "--out",
        "s",
    ]
    with subprocess.Popen(
        [sys.executable, "-c", run, *command], cwd=tmp_path, stderr=subprocess.PIPE
    ) as process:
        while not list(tmp_path.glob("s/chunks/*.npz")):
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(number)
        assert process.stderr is not None
        said = process.stderr.read().decode()
    assert process.returncode == 128 + number
    finished = len(list(tmp_path.glob("s/chunks/*.npz")))
    assert said == (
        f"starplumb: interrupted ({'Ctrl-C' if name == 'SIGINT' else name}); {64 * finished} of 2000000 trials are "
        "finished and kept in s/chunks, the same command with the same --out resumes them\n"
    )
    assert not list(tmp_path.rglob(".*"))


def test_what_a_library_says_of_a_full_disk_is_a_sentence(tmp_path, monkeypatch):
    pyogrio = pytest.importorskip("pyogrio")

    def full(path, **keywords):
        path.write_bytes(b"half")
        raise pyogrio.errors.FeatureError(f"{path}: sqlite3_exec(INSERT) failed")

    monkeypatch.setattr(pyogrio.raw, "write", full)
    place = np.zeros(1)
    with pytest.raises(InputError, match=r"found no way to write there \(map\.gpkg: sqlite3_exec"):
        publish(tmp_path, {"map.gpkg": lambda path: write_residuals(path, place, place, ["a"], [place])})
    assert list(tmp_path.iterdir()) == []
