"""Mistakes in a command line, what the shell completes, and what commands say about their own work."""

from __future__ import annotations

import json
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from typer.main import get_command
from typer.testing import CliRunner

from command import Spoken, demo, starplumb
from starplumb.cli.app import app
from starplumb.cli.options import complete
from starplumb.cli.reproduce import _cells
from starplumb.estimators import METHODS

GROUPS = get_command(app).commands
COMMANDS = {name: command for name, command in GROUPS.items() if not hasattr(command, "commands")} | {
    f"{name} {verb}": command
    for name, group in GROUPS.items()
    for verb, command in getattr(group, "commands", {}).items()
}


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["calbrate"], "starplumb: found the command calbrate, which there is not, wanted perhaps calibrate"),
        (
            ["calibrate", "c.toml", "--estimat", "x"],
            "calibrate: found the option --estimat, .* perhaps --estimate",
        ),
        (
            ["locate", "c.toml", "--imge", "a", "1", "2"],
            "locate: found the option --imge, .* perhaps --image",
        ),
        (["locate", "c.toml", "-z", "1", "2"], "locate: found the option -z, which there is not"),
        (["check", "c.toml", "d.toml"], r"check: found d\.toml too, wanted no more"),
        (["check", "c.toml", "--outside", "it"], '--outside: found "it", wanted one of .refuse., .skip.'),
        (
            ["project", "c.toml", "45", "-12", "--img=a"],
            "project: found the option --img, .* perhaps --image",
        ),
        (["locate", "c.toml", "1", "2"], "locate: found no --image / -i, wanted one"),
        (["locate"], "locate: found no CAMPAIGN.toml, wanted one"),
        (["check", "a.toml", "b.toml"], r"check: found b.toml too"),
        (
            ["simulate", "two-images", "--trials", "1e18"],
            'simulate: --trials / -n: found "1e18", wanted a whole number, 2 to 1000000000',
        ),
        (
            ["locate", "c.toml", "-i", "a", "5_00", "5"],
            'locate: COLUMN: found "5_00", wanted a finite number',
        ),
        (["locate", "c.toml", "-i", "a", "5", "٥"], 'locate: ROW: found "٥", wanted a finite number'),
        (
            ["locate", "c.toml", "-i", "a", "--sigma-px", "-1", "5", "5"],
            'px: found "-1", .* number, 0 or more',
        ),
        (["plan", "cubesat-6u", "--days", "nan"], 'plan: --days: found "nan", wanted a finite number'),
        (["archive", "trend", "x.db", "--horizon-days", "1_0"], 'trend: --horizon-days: found "1_0", wanted'),
        (["calibrate", "c.toml", "-j", 10**20], f'--jobs / -j: found "{10**20}", .* whole number, 1 to 1000'),
        (
            ["simulate", "two-images", "--chunk", 10**9],
            "--chunk: found .*, wanted a whole number, 1 to 100000",
        ),
        (["init", "d", "--seed", 10**20], "--seed / -s: .* number, 0 or more, of at most 20 digits"),
        (["calibrate", "c.toml", "--outside", "x"], "calibrate: --outside: .*refuse"),
        (["init", "d", "--seed"], "--seed"),
    ],
)
def test_a_mistake_is_one_line_with_what_was_meant(arguments, says):
    spoken = starplumb(*arguments)
    assert (spoken.status, spoken.out) == (2, "")
    assert re.fullmatch(f"starplumb: .*{says.removeprefix('starplumb: ')}.*\n", spoken.err), spoken.err


def test_without_a_command_the_help_is_shown():
    spoken = starplumb()
    assert spoken.status == 2
    assert spoken.err.startswith("Usage: starplumb")


def test_a_report_of_a_fault_can_name_what_was_run():
    told = starplumb("--version", "--verbose").out.splitlines()
    assert told[0] == starplumb("--version").out.strip()
    assert told[1].startswith(f"Python {sys.version.split()[0]} on ")
    assert f"numpy {np.__version__}" in told
    assert any(line.startswith("rasterio") for line in told)
    assert not any(line.startswith("pytest") for line in told)
    for odd in (["--verbose"], ["--verbose", "check", "a.toml"]):
        refused = starplumb(*odd)
        assert (refused.status, refused.out, refused.err.count("\n")) == (2, "", 1)


def test_summaries_of_commands_are_not_cut():
    spoken = starplumb("--help")
    assert "..." not in spoken.out.partition("Commands:")[2]
    assert "exit status 0" in " ".join(spoken.out.split())


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_options_say_what_they_take_and_have_the_same_short_names(command):
    short = {"out": "-o", "trials": "-n", "seed": "-s", "images": "-n", "method": "-m", "methods": "-m"}
    for option in COMMANDS[command].params:
        long = option.opts[0].lstrip("-")
        assert long not in short or short[long] in option.opts, f"{command} --{long}"
    options = starplumb(*command.split(), "--help").out.partition("Options:")[2]
    assert re.findall(r"<(?:str|int|float|path|list)\b.*?>", options, re.IGNORECASE) == []


def test_a_negative_number_is_no_option(tmp_path):
    path = demo(tmp_path / "demo", "--images", 1)
    outside = starplumb("locate", path, "--image", "image01", -10, 5)
    assert outside == Spoken(2, "", "starplumb: COLUMN: found -10, wanted -0.5 to 11999.5, the image\n")
    inside = starplumb("locate", path, "--image", "image01", "-.25", 5, "--height-m", -10, "--json")
    assert inside.status == 0
    assert json.loads(inside.out)["column_px"] == -0.25


def test_a_grid_tells_its_size_and_is_not_written_unasked_above_a_gigabyte(tmp_path):
    path, grid = demo(tmp_path / "demo", "--images", 1), tmp_path / "g.npy"
    refused = starplumb("locate", path, "--image", "image01", "--grid", grid)
    assert refused.status == 2
    # 12000 x 12000 pixels of three numbers of eight bytes
    assert "12000 x 12000 pixels, 3.46 GB, wanted --yes" in refused.err
    assert not grid.exists()
    written = starplumb("locate", path, "--image", "image01", "--grid", grid, "--every", 4000)
    assert written.status == 0
    assert "3 x 3 pixels, 216 bytes" in written.err
    assert grid.exists()


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("locate {campaign} --image image0", "image01 image02"),
        ("project {campaign} 45.1 12.3 -i im", "image01 image02"),
        ("locate {campaign}x --image im", ""),
        ("locate --image im", ""),
        ("calibrate {campaign} --drift a", "auto"),
        ("simulate two-images --trails 5 --samples no", "none"),
    ],
)
def test_the_shell_completes_a_line(tmp_path_factory, line, offered):
    """Images are those of the campaign on the line; and what is wrong elsewhere in the line is said later."""
    folder = tmp_path_factory.getbasetemp() / "completed"
    path = folder / "campaign.toml" if folder.exists() else demo(folder, "--images", 2)
    words = f"starplumb {line.format(campaign=path)}"
    asked = {"COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)}
    told = CliRunner().invoke(
        app, [], prog_name="starplumb", env={"_STARPLUMB_COMPLETE": "complete_bash", **asked}
    )
    assert told.output.split() == offered.split()


@pytest.mark.parametrize(
    ("command", "meant"),
    [
        (("reproduce", "tabel1"), "table1"),
        (("calibrate", "{campaign}", "--drift", "atuo"), "auto"),
        (("calibrate", "{campaign}", "--drift", "linear,orbt:2"), "orbit"),
        (("calibrate", "{campaign}", "--estimate", "focal_lenth"), "focal_length"),
        (("calibrate", "{campaign}", "--method", "gsl"), "gls"),
    ],
)
def test_the_nearest_name_is_told(tmp_path, command, meant):
    path = demo(tmp_path / "demo", "--images", 2) if "{campaign}" in command else None
    told = starplumb(*(word.format(campaign=path) for word in command))
    assert told.status == 2
    assert told.err.endswith(f"(did you mean {meant}?)\n")


def test_the_shell_completes_names():
    assert set(complete.methods("")) == set(METHODS)
    assert complete.methods("gls,wa") == ["gls,wahba"]
    assert complete.scenarios("two") == ["two-images"]
    assert complete.parameters("focal_length,time_offset_a") == ["focal_length,time_offset_attitude"]
    assert complete.tables("table") == ["table1", "table2", "table3", "table4"]
    assert complete.drifts("a") == ["auto"]
    assert complete.drifts("linear,st") == ["linear,step:"]
    assert complete.samples("p") == ["parquet"]
    assert complete.starts("") == ["closed-form", "model"]
    assert "campaign" in complete.documents("")


@pytest.mark.slow
def test_work_that_leaves_nothing_behind_says_so(tmp_path):
    told = starplumb("simulate", "two-images", "-n", 20)
    assert "nothing written (--out DIR" in told.out
    kept = starplumb("simulate", "two-images", "-n", 20, "-o", tmp_path / "study")
    assert f"written: {tmp_path / 'study'}" in kept.out
    assert "nothing written" not in kept.out


@pytest.mark.slow
def test_tables_of_whole_series_say_how_many_runs_were_not_used():
    told = starplumb("reproduce", "images-max", "-n", 300)
    assert "250 runs of ours of the 300 asked for" in told.out
    assert "300 runs of ours." in starplumb("reproduce", "table1", "-n", 300).out


def test_what_rounding_leaves_of_a_figure_and_of_its_error_is_nothing():
    ours = SimpleNamespace(value=(3e-14, 0.305, 2e-9), sampling=(7.9e-14, 0.0022, 1e-3))
    assert _cells(SimpleNamespace(ours=ours, published=(0.0, 0.3, float("nan")))) == [
        "0 (0)",
        "0.305±0.0022 (0.3)",
        "0±0.001",
    ]


def test_what_lacks_is_named_as_the_help_names_it(tmp_path):
    assert starplumb("simulate").err == (
        "starplumb: simulate: found no SCENARIO, wanted one (starplumb simulate --help says more)\n"
    )
    path = demo(tmp_path / "demo", "--images", 2)
    for command in ("calibrate", "check"):
        told = starplumb(command, path.parent)
        assert told.status == 2
        assert told.err == (
            f"starplumb: {path.parent}: found a folder, wanted the campaign.toml in it: {path}\n"
        )
