"""Pages and drawings made again for each build: a page for each command, the gallery of examples, the drawings."""

from __future__ import annotations

import ast
import shutil
import subprocess
import sys
import time
from pathlib import Path

from executed import environment
from sphinx.application import Sphinx
from sphinx.config import Config
from sphinx.errors import ExtensionError

LIMIT_S = 600
"""Longer than any example takes on a busy machine (a few seconds of computing): it must be hanging."""


def starplumb(*arguments: str) -> str:
    """What the command line prints."""
    code = "from starplumb.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env=environment(),
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.rstrip()


def command_names() -> list[str]:
    from starplumb.cli.app import app

    groups = [
        (group.name, [verb.name for verb in group.typer_instance.registered_commands])
        for group in app.registered_groups
        if group.typer_instance is not None
    ]
    verbs = [f"{name} {verb}" for name, found in groups for verb in found]
    return [*(command.name for command in app.registered_commands if command.name), *verbs]


def write_commands(folder: Path) -> None:
    """The help of every command, a page each, and that of the program."""
    folder.mkdir(parents=True)
    for name in command_names():
        text = f"# starplumb {name}\n\n```text\n{starplumb(*name.split(), '--help')}\n```\n"
        (folder / f"{name.replace(' ', '-')}.md").write_text(text, encoding="utf-8")
    names = "\n".join(name.replace(" ", "-") for name in command_names())
    toctree = f"```{{toctree}}\n:maxdepth: 1\n\n{names}\n```\n"
    text = f"# Command by command\n\n```text\n{starplumb('--help')}\n```\n\n{toctree}"
    (folder / "index.md").write_text(text, encoding="utf-8")


def write_gallery(examples: list[Path], folder: Path) -> None:
    """Every example is run; its page has its text, figures, output and source."""
    folder.mkdir(parents=True)
    for example in examples:
        write_example(example, folder)
    names = "\n".join(example.stem for example in examples)
    thumbnails = "\n\n".join(thumbnail(example, folder) for example in examples)
    text = (
        "# Gallery\n\nEach page is a script of the folder `examples`, run when this documentation was built: "
        "`python examples/NAME.py` prints the same and leaves the figures in the folder it is run in.\n\n"
        f"{thumbnails}\n\n```{{toctree}}\n:hidden:\n\n{names}\n```\n"
    )
    (folder / "index.md").write_text(text, encoding="utf-8")


def title_and_text(example: Path) -> tuple[str, str]:
    """What the example's docstring says: its first sentence without the stop, and the rest."""
    title, _, text = (ast.get_docstring(ast.parse(example.read_text(encoding="utf-8"))) or "").partition("\n")
    return title.rstrip("."), text.strip()


def figures_of(example: Path, folder: Path) -> list[str]:
    """The figures that an example left in its folder, as seen from the gallery's pages."""
    return [f"{example.stem}/{figure.name}" for figure in sorted((folder / example.stem).glob("*.svg"))]


def thumbnail(example: Path, folder: Path) -> str:
    """The first figure of an example, small, with its title below; both lead to its page."""
    title, _ = title_and_text(example)
    return (
        f"```{{figure}} {figures_of(example, folder)[0]}\n:alt: {title}\n:target: {example.stem}.html\n"
        f":figclass: thumbnail\n\n{{doc}}`{title} <{example.stem}>`\n```"
    )


def write_example(example: Path, folder: Path) -> None:
    work = folder / example.stem
    work.mkdir()
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, str(example)],
        cwd=work,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    if done.returncode:
        raise ExtensionError(f"{example} ended with {done.returncode}:\n{done.stderr}")
    title, text = title_and_text(example)
    parts = [
        f"# {title}",
        text,
        *(f"![{title}]({figure})" for figure in figures_of(example, folder)),
        f"`python examples/{example.name}`, {time.perf_counter() - start:.1f} s in this build:",
        f"```text\n{done.stdout.rstrip()}\n```",
        f"```{{literalinclude}} /../examples/{example.name}\n:language: python\n```",
    ]
    (folder / f"{example.stem}.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def generate(app: Sphinx, config: Config) -> None:
    source = Path(app.srcdir)
    made = source / "generated"
    shutil.rmtree(made, ignore_errors=True)
    for name in ("extra", "executed"):
        (made / name).mkdir(parents=True)
    subprocess.run(
        [sys.executable, str(source / "drawings.py"), str(made / "drawings")], env=environment(), check=True
    )
    write_commands(made / "commands")
    write_gallery(sorted((source.parent / "examples").glob("[!_]*.py")), made / "gallery")


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("config-inited", generate, priority=100)  # before the builder looks for the folders made here
    return {"parallel_read_safe": True, "parallel_write_safe": True}
