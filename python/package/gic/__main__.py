"""The command ``gic``."""

import sys
from pathlib import Path

from . import _gic


def main() -> int:
    """Runs the command line of this process and returns the exit code."""
    words = list(sys.argv)
    if Path(words[0]).name == "__main__.py":
        words[0] = "gic"
    return _gic.cli(words)


if __name__ == "__main__":
    sys.exit(main())
