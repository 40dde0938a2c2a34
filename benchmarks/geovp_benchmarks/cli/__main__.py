"""`python -m geovp_benchmarks.cli` is `geovp`."""

import sys

from geovp_benchmarks.cli import main

if __name__ == "__main__":
    sys.exit(main())
