"""Print the error budget of a method.

Stages of the method are replaced by the truth, alone and one after the other. Differences are
paired over clips.

Examples:
  geovp budget budget --root path/to/kitti
  geovp budget demo --method 'vo+prior + fusion' --limit 3
"""

import argparse

from geovp_benchmarks.cli.options import Lines, shared

ARGUMENTS = {
    "": shared("matrix"),
    "method and clips": shared("--method", "--root", "--limit", "--set"),
    "budget": {
        "--stereo": "Use the depth of right images where no depth is recorded.",
    },
}


def run(args: argparse.Namespace) -> Lines:
    """Print a table per metric."""
    from geovp_benchmarks.error_budget import changes
    from geovp_benchmarks.matrix import schema
    from geovp_benchmarks.tables.formats import markdown
    from geovp_classic.types import PrivilegedInput

    matrix = schema.read(args.matrix, args.set).override(root=args.root)
    needs = PrivilegedInput.RIGHT_FRAMES if args.stereo else PrivilegedInput.NONE
    method = changes.read_method(matrix, args.method, args.limit, needs)
    yield from map(markdown, changes.error_budget(method))
