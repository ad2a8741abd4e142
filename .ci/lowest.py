"""Prints the lowest versions that pyproject.toml allows, as constraints for pip.

    python .ci/lowest.py > lowest.txt && pip install --constraint lowest.txt ".[test]"

The lower bounds stand in pyproject.toml only; what these packages themselves require is pip's choice.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
BOUND = re.compile(r"(?P<name>[\w.-]+)\s*>=\s*(?P<version>[\w.]+)")

if __name__ == "__main__":
    optional = PROJECT["optional-dependencies"].values()
    stated = [BOUND.match(entry) for entries in (PROJECT["dependencies"], *optional) for entry in entries]
    print(*sorted({f"{bound['name']}=={bound['version']}" for bound in stated if bound}), sep="\n")
