"""What libraries say of themselves, kept from the terminal."""

from __future__ import annotations

import logging


def keep_quiet(library: str) -> None:
    """Let Python print nothing that a library logs, as it does where a program has set up no log of its own.

    A program that has gets all of it as before.
    """
    log = logging.getLogger(library)
    if not any(isinstance(handler, logging.NullHandler) for handler in log.handlers):
        log.addHandler(logging.NullHandler())
