"""Directives that run what a page shows while the page is read, so that it shows what the program says today.

``{run}`` runs shell commands, ``{python}`` a script, ``{file}`` writes a file; ``{show}`` prints one that was written,
``{picture}`` includes a figure and ``{attach}`` links a whole page.  All blocks of a page share one folder, which
holds only the examples when the page begins.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

LIMIT_S = 600
"""Longer than any block takes on a busy machine: it must be hanging."""
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
logger = logging.getLogger(__name__)


def environment() -> dict[str, str]:
    """What commands run in: this interpreter first on the path, one thread, plain output 88 columns wide."""
    bins = Path(sys.executable).parent
    plain = {
        "COLUMNS": "88",
        "NO_COLOR": "1",
        "TERM": "dumb",
        "MPLBACKEND": "Agg",
        "OPENBLAS_NUM_THREADS": "1",
    }
    path = f"{bins}{os.pathsep}{os.environ.get('PATH', '')}"
    return {**os.environ, "PATH": path, **plain}


def commands(lines: list[str]) -> list[str]:
    """The commands of a block; one that ends a line with a backslash goes on in the next."""
    whole: list[str] = []
    for line in lines:
        if whole and whole[-1].endswith("\\"):
            whole[-1] += "\n" + line
        elif line.strip():
            whole.append(line)
    return whole


class Executed(SphinxDirective):
    """What all of them share: the page's folder."""

    has_content = True

    @property
    def folder(self) -> Path:
        folder = Path(self.env.doctreedir) / "executed" / self.env.docname
        if self.env.temp_data.get("executed") != self.env.docname:
            self.env.temp_data["executed"] = self.env.docname
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            (folder / "examples").symlink_to(EXAMPLES)
            self.env.note_reread()
        return folder

    def published(self, name: str) -> Path:
        """Where a file of this page goes to be found by the builder."""
        flat = f"{self.env.docname}-{name}".replace("/", "-")
        return Path(self.env.srcdir) / "generated" / "executed" / flat

    def execute(self, arguments: list[str], wanted: int) -> str:
        done = subprocess.run(
            arguments,
            cwd=self.folder,
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=LIMIT_S,
            check=False,
        )
        output = done.stdout.replace(str(self.folder), ".")
        if done.returncode != wanted:
            shown = f"{' '.join(arguments[-1:])!r} ended with {done.returncode}, wanted {wanted}:\n{output}"
            logger.warning(shown, location=self.get_location(), type="executed")
        return "\n".join(line.rstrip() for line in output.rstrip().splitlines())

    def block(self, text: str, language: str) -> nodes.literal_block:
        node = nodes.literal_block(text, text)
        node["language"] = language
        self.set_source_info(node)
        return node


class Run(Executed):
    """Shell commands with what they print.  ``:status:`` the exit status wanted of each; ``:lines:`` how many lines of
    each output to keep; ``:quiet:`` shows no output, ``:hidden:`` nothing."""

    option_spec: ClassVar = {
        "status": directives.nonnegative_int,
        "lines": directives.positive_int,
        "quiet": directives.flag,
        "hidden": directives.flag,
    }

    def run(self) -> list[nodes.Node]:
        shown = []
        for command in commands(list(self.content)):
            output = self.execute(
                ["bash", "-euo", "pipefail", "-c", command], self.options.get("status", 0)
            ).splitlines()
            keep = self.options.get("lines", len(output))
            shown.append("$ " + command.replace("\n", "\n> "))
            if "quiet" not in self.options:
                shown += [*output[:keep], *(["..."] if len(output) > keep else [])]
        return [] if "hidden" in self.options else [self.block("\n".join(shown), "console")]


class Python(Executed):
    """A script and what it prints."""

    def run(self) -> list[nodes.Node]:
        code = "\n".join(self.content)
        output = self.execute([sys.executable, "-c", code], 0)
        printed = [self.block(output, "text")] if output else []
        return [self.block(code, "python"), *printed]


class File(Executed):
    """A text file that the reader would write by hand."""

    required_arguments = 1
    option_spec: ClassVar = {"language": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        text = "\n".join(self.content)
        (self.folder / self.arguments[0]).write_text(text + "\n", encoding="utf-8")
        return [self.block(text, self.options.get("language", "text"))]


class Show(Executed):
    """A text file of the page's folder; ``:lines:`` how many from its start, ``:language:`` to colour it."""

    required_arguments = 1
    option_spec: ClassVar = {"lines": directives.positive_int, "language": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        lines = (self.folder / self.arguments[0]).read_text(encoding="utf-8").splitlines()
        keep = self.options.get("lines", len(lines))
        text = "\n".join([*lines[:keep], *(["..."] if len(lines) > keep else [])])
        return [self.block(text, self.options.get("language", "text"))]


class Picture(Executed):
    """A figure of the page's folder; the text below is its alternative text."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        target = self.published(self.arguments[0])
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(self.folder / self.arguments[0], target)
        image = nodes.image(uri=f"/generated/executed/{target.name}", alt=" ".join(self.content))
        self.set_source_info(image)
        return [image]


class Attach(Executed):
    """A link to a page of the folder, copied beside the documentation; the text below is that of the link."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        target = (
            self.published(self.arguments[0]).parent.parent / "extra" / self.published(self.arguments[0]).name
        )
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(self.folder / self.arguments[0], target)
        up = "../" * self.env.docname.count("/")
        text = " ".join(self.content)
        return [nodes.paragraph("", "", nodes.reference("", text, refuri=up + target.name))]


def setup(app: Sphinx) -> dict[str, bool]:
    for name, directive in (
        ("run", Run),
        ("python", Python),
        ("file", File),
        ("show", Show),
        ("picture", Picture),
        ("attach", Attach),
    ):
        app.add_directive(name, directive)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
