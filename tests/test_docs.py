"""What the documentation says is true today: examples run, pasted output is printed, links lead somewhere."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.main import get_command

from starplumb.cli.app import app

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
EXAMPLES = sorted((ROOT / "examples").glob("[!_]*.py"))
GROUPS = get_command(app).commands  # type: ignore[attr-defined]
COMMANDS = {name: command for name, command in GROUPS.items() if not hasattr(command, "commands")}
COMMANDS |= {
    f"{name} {verb}": command
    for name, group in GROUPS.items()
    for verb, command in getattr(group, "commands", {}).items()
}


def _run(arguments: list[str], folder: Path) -> str:
    plain = {"COLUMNS": "80", "NO_COLOR": "1", "TERM": "dumb", "MPLBACKEND": "Agg"}
    done = subprocess.run(arguments, cwd=folder, env={**os.environ, **plain}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def _block(after: str) -> str:
    """The text of the README's block behind a marker."""
    found = re.search(re.escape(f"<!-- {after} -->") + r"\n```\w*\n(.*?)```", README, re.DOTALL)
    assert found is not None, f"no block {after}"
    return found[1]


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs_and_leaves_a_figure(example: Path, tmp_path: Path) -> None:
    printed = _run([sys.executable, str(example)], tmp_path)
    assert printed.strip()
    assert list(tmp_path.glob("*.svg"))


@pytest.mark.slow
def test_readme_shows_what_the_command_prints(tmp_path: Path) -> None:
    program = [sys.executable, "-c", "from starplumb.cli import main; main()"]
    _run([*program, "init", "demo"], tmp_path)
    printed = _run([*program, "calibrate", "demo/campaign.toml"], tmp_path)
    assert printed.strip() == _block("output: starplumb calibrate demo/campaign.toml").strip()


@pytest.mark.slow
def test_readme_snippet_saves_the_files_of_the_command(tmp_path: Path) -> None:
    printed = _run([sys.executable, "-c", _block("run: python")], tmp_path)
    saved = json.loads((tmp_path / "result" / "result.json").read_text(encoding="utf-8"))
    shown = [float(number) for number in re.findall(r"\d+\.\d+", printed.splitlines()[-1])]
    assert shown == pytest.approx(saved["sigma_arcsec"], rel=1e-6)
    error = saved["truth"]["error_arcsec"]
    assert all(abs(e) < 4.0 * s for e, s in zip(error, shown, strict=True))
    names = {path.name for path in (tmp_path / "result").iterdir()}
    assert names == {"result.json", "residuals.csv", "report.html", "mounting.tf", "normals.json"}


@pytest.mark.parametrize(
    "page", [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")], ids=lambda p: p.name
)
def test_links_lead_to_files(page: Path) -> None:
    targets = re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8"))
    assert [target for target in targets if not (page.parent / target).exists()] == []


def test_referenced_pages_exist() -> None:
    """Every {doc} role of a page names a page, or one that the build makes of an example."""
    made = {f"generated/gallery/{path.stem}" for path in EXAMPLES} | {"generated/gallery/index"}
    missing = []
    for page in (ROOT / "docs").rglob("*.md"):
        relative = page.relative_to(ROOT / "docs")
        if relative.parts[0] in ("generated", "_build"):
            continue
        for target in re.findall(r"\{doc\}`(?:[^`<]*<)?([^`<>]+)>?`", page.read_text(encoding="utf-8")):
            place = target[1:] if target.startswith("/") else (relative.parent / target).as_posix()
            if place not in made and not (ROOT / "docs" / f"{place}.md").exists():
                missing.append(f"{relative}: {target}")
    assert missing == []


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_the_common_options_and_an_example(name: str) -> None:
    command = COMMANDS[name]
    options = {option for parameter in command.params for option in parameter.opts}
    assert {"--json", "--quiet", "--verbose"} <= options
    assert "Example" in command.help
    assert f"starplumb {name} " in command.help
    silent = [p.name for p in command.params if not getattr(p, "help", None)]
    assert silent == []


def test_signatures_are_shown_as_they_are_written(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(ROOT / "docs" / "_ext")
    from signatures import as_written  # type: ignore[import-not-found]

    from starplumb.session.campaign import demo

    shown = as_written(None, "function", "demo", demo, None, "()", "")
    wanted = "(camera: Literal['frame', 'line-scan'] = 'frame', images: DemoImages = 8, seed: Seed = 1)"
    assert shown == (wanted, "~starplumb.session.campaign.Campaign")


def test_exit_statuses_are_documented() -> None:
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    for status in (0, 2, 3, 130):
        assert f"| {status} |" in page
