"""A page as PDF, by WeasyPrint or a browser, whichever is there."""

from __future__ import annotations

import os
import shutil
import subprocess
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from ..physics.errors import InputError

BROWSERS = (
    *("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome"),
    *("microsoft-edge", "msedge", "brave-browser"),
)
SECONDS = 120.0
"""A browser that has not printed a page by then will not."""


def require_printer() -> None:
    """Raise InputError where nothing is there that prints a page."""
    if find_spec("weasyprint") is None and _browser() is None:
        raise InputError(
            f"--pdf: found neither WeasyPrint nor a browser ({', '.join(BROWSERS[:3])}, ...), wanted one of them; "
            "report.html prints from any browser"
        )


def _browser() -> str | None:
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)


def write_pdf(page: str, to: Path) -> None:
    """Write a page (its text) as PDF.  Raises InputError where that fails."""
    if find_spec("weasyprint") is not None:
        from importlib import import_module

        import_module("weasyprint").HTML(string=page).write_pdf(to)
        return
    with TemporaryDirectory() as folder:
        made = Path(folder) / "page.pdf"
        (Path(folder) / "page.html").write_text(page, encoding="utf-8")
        _print(Path(folder), made)
        shutil.copyfile(made, to)


def _print(folder: Path, made: Path) -> None:
    """Have the browser print page.html of a folder, with a profile of its own."""
    browser = _browser() or BROWSERS[0]
    options = ["--headless", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        options.append("--no-sandbox")  # browsers start for root only so; the page is ours and loads nothing
    command = [
        *(browser, *options, f"--user-data-dir={folder / 'profile'}", "--no-pdf-header-footer"),
        *(f"--print-to-pdf={made}", (folder / "page.html").as_uri()),
    ]
    with suppress(OSError, subprocess.TimeoutExpired):  # there is then no file
        subprocess.run(command, capture_output=True, timeout=SECONDS, check=False)
    if not made.is_file():
        raise InputError(f"--pdf: found that {browser} printed nothing, wanted WeasyPrint or another browser")
