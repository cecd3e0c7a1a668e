"""``python -m ravec``: the command line."""

import sys

from . import _ravec


def main() -> int:
    """Runs the command line with the arguments of the process."""
    return _ravec.main(["ravec", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
