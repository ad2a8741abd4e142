"""The house: floors, who prints, and what is not loaded before it is needed."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import starplumb

ROOT = Path(starplumb.__file__).parent
MODULES = {
    path.relative_to(ROOT)
    .with_suffix("")
    .as_posix()
    .replace("/", ".")
    .removesuffix("__init__")
    .rstrip("."): path
    for path in ROOT.rglob("*.py")
}
FOLDERS = (
    *(
        "physics",
        "disk",
        "table",
        "solve",
        "estimators",
        "judge",
        "identify",
        "ground",
        "imagery",
        "plan",
        "study",
        "mission",
    ),
    *(
        "io.text",
        "io.tables",
        "io.formats",
        "io.gis",
        "io.points",
        "io.imagery",
        "io.campaign",
        "io.drawn",
        "io.scenario",
        "io.vendors",
        "io.results",
        "io.archive",
    ),
    *("documents", "report", "published", "session", "cli"),
)
"""A folder is a stage of the work, in the order of the work: it imports from those before it only."""
MOST_MODULES = 15
LAZY = {""}
"""The package's own face names folders further on, in strings."""
HEAVY = {
    "scipy",
    "matplotlib",
    "pyogrio",
    "rasterio",
    "pyproj",
    "pyarrow",
    "spiceypy",
    "numba",
    "dask",
    "distributed",
    "pandas",
}


def folder(module):
    """The folder of a module, None for the package's own face."""
    return next((name for name in FOLDERS if module == name or module.startswith(f"{name}.")), None)


@cache
def tree(module):
    return ast.parse(MODULES[module].read_text(encoding="utf-8"))


def named(arguments, package):
    """The parts of a module's name that ``import_module`` is given as a string; of one that is computed, nothing."""
    if not isinstance(arguments[0], ast.Constant):
        return [""]
    text = arguments[0].value
    above = len(text) - len(text.lstrip("."))
    return [*package[: len(package) - above + 1 if above else 0], *text.lstrip(".").split(".")]


@cache
def imported(module):
    """Modules of the package that a module imports, anywhere in its text: in functions and for type checking too."""
    path = MODULES[module]
    package = ["starplumb", *path.relative_to(ROOT).parent.parts]
    found = set()
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.Import):
            names = [alias.name.split(".") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            base = [*base, *(node.module or "").split(".")] if node.module else base
            names = [[*base, alias.name] for alias in node.names]
        elif isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] == "import_module":
            names = [named(node.args, package)]
        else:
            continue
        for name in names:
            if name[0] == "starplumb":
                whole = ".".join(name[1:])
                found.add(whole if whole in MODULES else whole.rpartition(".")[0])
    assert found <= set(MODULES), f"{module} imports what is not there: {found - set(MODULES)}"
    return found - {module}


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        ('import_module("numba")', ["numba"]),
        ('import_module("starplumb.cli.app")', ["starplumb", "cli", "app"]),
        ('import_module(".run", __name__)', ["starplumb", "study", "run"]),
        ('import_module("..cli.app", "starplumb.study")', ["starplumb", "cli", "app"]),
        ("import_module(name)", [""]),
    ],
)
def test_a_module_named_in_a_string_counts_as_imported(call, parts):
    assert named(ast.parse(call, mode="eval").body.args, ["starplumb", "study"]) == parts


def test_every_module_lives_in_a_folder_of_the_plan():
    assert {module for module in MODULES if folder(module) is None} == {"", "io", "__main__"}


@pytest.mark.slow
@pytest.mark.parametrize("module", sorted(MODULES))
def test_a_folder_imports_only_from_those_before_it(module):
    if module in LAZY:
        assert not imported(module)
        return
    later = {
        other
        for other in imported(module)
        if other not in ("", "io") and FOLDERS.index(folder(other)) > FOLDERS.index(folder(module) or "cli")
    }
    assert not later, f"{module} imports {later}"


def test_imports_make_no_circle():
    """Every import counts, wherever it stands."""
    left = {module: set(imported(module)) for module in MODULES}
    while left:
        free = {module for module, others in left.items() if not others & set(left)}
        assert free, f"these import one another: {sorted(left)}"
        left = {module: others for module, others in left.items() if module not in free}


@pytest.mark.parametrize("name", FOLDERS)
def test_a_folder_can_be_overlooked(name):
    beside = [path for path in (ROOT / name.replace(".", "/")).glob("*.py") if path.name != "__init__.py"]
    assert len(beside) <= MOST_MODULES


@pytest.mark.parametrize("module", sorted(m for m in MODULES if folder(m) != "cli"))
def test_only_the_command_line_prints(module):
    calls = [node.func for node in ast.walk(tree(module)) if isinstance(node, ast.Call)]
    assert not any(isinstance(f, ast.Name) and f.id == "print" for f in calls)
    names = {node.attr for node in ast.walk(tree(module)) if isinstance(node, ast.Attribute)}
    assert not names & {"stdout", "stderr", "echo"}


@pytest.mark.parametrize("module", sorted(MODULES))
def test_heavy_packages_are_imported_where_they_are_used(module):
    """At module level they would be loaded by every command."""
    at_the_top = set()
    for node in tree(module).body:
        if isinstance(node, ast.Import):
            at_the_top |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            at_the_top.add((node.module or "").split(".")[0])
    assert not at_the_top & HEAVY


@pytest.mark.parametrize(
    "does",
    ["import starplumb", "import starplumb.cli.app; import starplumb.cli; starplumb.cli.main()"],
    ids=["import", "help"],
)
def test_nothing_heavy_is_loaded_to_say_hello(does):
    code = f"import sys; sys.argv = ['starplumb', '--help']\ntry:\n    {does}\nexcept SystemExit:\n    pass\n"
    code += "print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in done.stderr.split()}
    assert "starplumb" in loaded
    assert not loaded & (HEAVY | {"numpy", "pydantic", "erfa", "jinja2"})
    assert "rich.console" not in done.stderr.split()


def test_an_archive_is_read_without_what_campaigns_need():
    """Its trend is asked for often: what makes and checks results is loaded by who does so."""
    code = "import sys, starplumb.session.mission.archive as a, starplumb.session.mission.trend_document\n"
    code += "a.Archive.show, a.Archive.trend; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert "starplumb.mission.trend" in loaded
    assert not loaded & {
        "pydantic",
        "erfa",
        "starplumb.estimators",
        "starplumb.judge.calibrate",
        "starplumb.io.campaign",
    }
