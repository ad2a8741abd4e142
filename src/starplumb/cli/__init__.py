"""The command line: the only place that prints."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command; a user's mistake ends in one line on standard error and the exit status of the interface."""
    from ..physics.errors import AlignmentFailed, InputError
    from .app import app
    from .usage import UsageError, sentence

    try:
        sys.exit(app(prog_name="starplumb", standalone_mode=False))
    except UsageError as error:
        if said := sentence(error):
            print(f"starplumb: {said}", file=sys.stderr)
        else:
            error.show()  # type: ignore[attr-defined]
        sys.exit(2)
    except InputError as error:
        _complain(error)
        sys.exit(2)
    except AlignmentFailed as error:
        _complain(error)
        sys.exit(3)
    except KeyboardInterrupt:
        print("starplumb: interrupted", file=sys.stderr)
        sys.exit(130)


def _complain(error: Exception) -> None:
    from ..physics.errors import ArgumentError

    text = " ".join((error.as_option if isinstance(error, ArgumentError) else str(error)).split())
    print(f"starplumb: {text}", file=sys.stderr)
