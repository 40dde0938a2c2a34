"""`python -m benchmarks.forecasting VERB` is `geovp forecast VERB`."""

import sys

from benchmarks import cli

if __name__ == "__main__":
    sys.exit(cli.main(["forecast", *sys.argv[1:]]))
