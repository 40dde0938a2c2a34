"""Command line of the studies: `python benchmarks/studies NAME ...`."""

import sys
from pathlib import Path

sys.path[0] = str(Path(__file__).parents[1])  # in place of this folder

from studies import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
