"""The command line: the only place that prints."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


def main() -> None:
    """Run the command; a user's mistake ends in one line on standard error and the exit status of the interface.

    One thread for linear algebra, set before NumPy is loaded: what a command finds does not depend on the machine.
    """
    from ..study.threads import one_thread

    # the settings are checked by what pydantic has itself: looking for plugins reads every package installed
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    with one_thread(), few_collections():
        _run()


@contextmanager
def few_collections() -> Iterator[None]:
    """Where Python seldom looks for circles of objects, and not through all that was loaded as it ends: it would find
    none, for an eighth of the time of a small command."""
    before = gc.get_threshold()
    gc.set_threshold(200_000, 10, 10)
    atexit.register(gc.freeze)
    try:
        yield
    finally:
        gc.set_threshold(*before)


def _run() -> None:
    from ..disk.interruption import name_of, stop_as_by_ctrl_c
    from ..physics.errors import AlignmentFailed, InputError
    from .app import asked, program
    from .channels import Interrupted, complain, finish, forget_output, is_of_output, prepare
    from .usage import UsageError, sentence

    prepare()
    stop_as_by_ctrl_c()
    try:
        finish(lambda: sys.exit(program(asked(sys.argv[1:]))(prog_name="starplumb", standalone_mode=False)))
    except UsageError as error:
        if said := sentence(error):
            complain(said)
        sys.exit(2)
    except InputError as error:
        complain(_as_option(error))
        sys.exit(2)
    except AlignmentFailed as error:
        complain(str(error))
        sys.exit(3)
    except (Interrupted, KeyboardInterrupt) as error:
        number = int(getattr(error, "number", 2))
        complain(f"interrupted ({name_of(number)}){getattr(error, 'kept', '')}")
        sys.exit(128 + number)
    except MemoryError:
        complain("found no memory left for this, wanted more of it, or less to be done at once")
        sys.exit(2)
    except OSError as error:
        if not is_of_output(error):
            raise
        forget_output()
        complain(
            f"standard output: found no way to write there ({error.strerror}), wanted one that takes all"
        )
        sys.exit(2)


def _as_option(error: Exception) -> str:
    from ..physics.errors import ArgumentError

    return error.as_option if isinstance(error, ArgumentError) else str(error)
