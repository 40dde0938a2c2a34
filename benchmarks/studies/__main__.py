"""Command line of the studies: `python benchmarks/studies NAME ...`."""

import sys
from pathlib import Path

sys.path[0] = str(Path(__file__).parents[1])  # in place of this folder

from geovp_benchmarks import cli  # noqa: E402
from studies import command_line  # noqa: E402

if __name__ == "__main__":
    sys.exit(cli.main(parser=command_line()))
