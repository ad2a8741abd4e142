"""What is delivered: every file of the package in the wheel, extras that agree with the messages that name them."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import starplumb

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "starplumb"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]


def _tracked(folder: str) -> set[str]:
    """Files under a folder of the checkout that git knows."""
    listed = subprocess.run(
        ["git", "ls-files", folder], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listed.returncode:
        pytest.skip("not a git checkout")
    return set(listed.stdout.split())


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    builders = pytest.importorskip("hatchling.builders.wheel")
    folder = tmp_path_factory.mktemp("dist")
    made = list(builders.WheelBuilder(str(ROOT)).build(directory=str(folder), versions=["standard"]))
    return zipfile.ZipFile(made[0])


def test_wheel_holds_every_file_of_the_package(wheel: zipfile.ZipFile) -> None:
    wanted = {name.removeprefix("src/") for name in _tracked("src/starplumb") if (ROOT / name).exists()}
    kinds = {Path(name).suffix or Path(name).name for name in wanted}
    assert {".py", ".toml", ".csv", ".j2", ".css", ".typed"} <= kinds
    assert wanted - set(wheel.namelist()) == set()


def test_wheel_has_its_licence_and_command(wheel: zipfile.ZipFile) -> None:
    info = f"starplumb-{starplumb.__version__}.dist-info"
    assert "Apache License" in wheel.read(f"{info}/licenses/LICENSE").decode()
    assert "starplumb = starplumb.cli:main" in wheel.read(f"{info}/entry_points.txt").decode()


def test_extras_named_in_messages_exist() -> None:
    named = {
        extra
        for file in SOURCE.rglob("*.py")
        for extra in re.findall(r"starplumb\[(\w+)\]", file.read_text(encoding="utf-8"))
    }
    assert named
    assert named - set(EXTRAS) == set()


def test_dev_brings_every_extra() -> None:
    """But the oracles: large, without wheels for some machines, and the tests that ask them skip."""
    listed = re.findall(r"starplumb\[([\w,]+)\]", " ".join(EXTRAS["dev"]))
    assert set(",".join(listed).split(",")) == set(EXTRAS) - {"dev", "oracles"}


def test_nothing_but_the_package_is_in_the_wheel(wheel: zipfile.ZipFile) -> None:
    info = f"starplumb-{starplumb.__version__}.dist-info"
    assert {name.split("/")[0] for name in wheel.namelist()} == {"starplumb", info}
    assert not [name for name in wheel.namelist() if "__pycache__" in name or "test" in Path(name).name]


def test_versions_agree(wheel: zipfile.ZipFile) -> None:
    """The package's own number is the one place; the citation repeats it."""
    metadata = wheel.read(f"starplumb-{starplumb.__version__}.dist-info/METADATA").decode()
    assert f"\nVersion: {starplumb.__version__}\n" in metadata
    assert f"version: {starplumb.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_the_conda_recipe_asks_what_the_package_asks() -> None:
    """Under the names of conda-forge, which splits matplotlib; and the version is ours."""
    recipe = (ROOT / "packaging" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    run = re.search(r"^  run:\n((?:    - .*\n)+)", recipe, re.MULTILINE)
    assert run is not None
    asked = {line.strip(" -").replace(" ", "") for line in run[1].splitlines()}
    wanted = {entry.replace("matplotlib>", "matplotlib-base>") for entry in PROJECT["dependencies"]}
    assert asked == wanted | {f"python{PROJECT['requires-python']}"}
    assert f'version: "{starplumb.__version__}"' in recipe


def test_the_container_installs_extras_that_exist_from_files_that_exist() -> None:
    text = (ROOT / "Containerfile").read_text(encoding="utf-8")
    asked = re.findall(r"/src\[([\w,]+)\]", text)[0].split(",")
    assert set(asked) <= set(EXTRAS)
    copied = [words.split()[1:-1] for words in text.splitlines() if words.startswith("COPY")]
    assert copied
    assert all((ROOT / name).exists() for names in copied for name in names)


def test_badges_say_what_the_project_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "docs")
    import badges  # type: ignore[import-not-found]

    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for name, (word, value) in badges.facts().items():
        assert (badges.FOLDER / f"{name}.svg").read_text(encoding="utf-8") == badges.badge(word, value)
        assert f"![{word}: {value}](docs/_static/badges/{name}.svg)" in readme


def test_every_requirement_has_a_lowest_version() -> None:
    """They are what .ci/run installs and tests; a requirement without one would be tested at its newest only."""
    named = [*PROJECT["dependencies"], *(entry for entries in EXTRAS.values() for entry in entries)]
    named = [entry for entry in named if not entry.startswith(("starplumb", "naif-"))]
    done = subprocess.run(
        [sys.executable, ROOT / ".ci" / "lowest.py"], capture_output=True, text=True, check=True
    )
    lowest = dict(line.split("==") for line in done.stdout.split())
    assert {re.split(r"[>=<~!;\s]", entry)[0] for entry in named} == set(lowest)
    assert all(f">={lowest[entry.split('>=')[0]]}" in entry for entry in named)
