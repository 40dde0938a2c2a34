"""`python -m benchmarks.forecasting VERB`: what `command` says, printed."""

import sys

from benchmarks.forecasting import command
from geovp_classic.errors import GeovpError

if __name__ == "__main__":
    try:
        for line in command.lines():
            sys.stdout.write(line + "\n")
            sys.stdout.flush()
    except GeovpError as error:
        sys.exit(f"geovp: {error}")
