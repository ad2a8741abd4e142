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
    path.relative_to(ROOT).with_suffix("").as_posix().replace("/", "."): path for path in ROOT.rglob("*.py")
}
FLOORS = {
    0: "errors units so3 tridiagonal conjugate rows",
    1: "earth timescales orientation orbit lens camera series corrections layout",
    2: "campaign trackers observations model geometry adjustment whitening arrow elimination covisibility streaming "
    "parameters design_rows",
    3: "estimators simulate scene passes sources error_models reliability portions",
    4: "",  # what studies, judges and plans: every module not named elsewhere
    5: "io report published",
    6: "cli",
}
HEAVY = {
    "scipy",
    "matplotlib",
    "pyogrio",
    "rasterio",
    "pyarrow",
    "spiceypy",
    "numba",
    "dask",
    "distributed",
    "pandas",
}


def floor(module):
    top = module.split(".")[0]
    return next((number for number, names in FLOORS.items() if top in names.split()), 4)


@cache
def tree(module):
    return ast.parse(MODULES[module].read_text(encoding="utf-8"))


def imported(module):
    """Modules of the package that a module imports, anywhere in its text."""
    package = ["starplumb", *MODULES[module].relative_to(ROOT).parent.parts]
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            base = [*base, *(node.module or "").split(".")] if node.module else base
            for name in node.names:
                path = [*base, name.name]
                if path[0] == "starplumb":
                    yield next(
                        (
                            ".".join(path[1:n])
                            for n in (len(path), len(path) - 1)
                            if ".".join(path[1:n]) in MODULES
                        ),
                        "",
                    )


@pytest.mark.parametrize("module", sorted(MODULES))
def test_a_module_imports_from_its_own_floor_or_below(module):
    above = {other for other in imported(module) if other and floor(other) > floor(module)}
    assert not above, f"{module} (floor {floor(module)}) imports {above}"


@pytest.mark.parametrize("module", sorted(m for m in MODULES if floor(m) < 6))
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
