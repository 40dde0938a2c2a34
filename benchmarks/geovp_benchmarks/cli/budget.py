"""Print the error budget of a method.

Stages of the method are replaced by the truth, alone and one after the other. Differences are
paired over clips.

Examples:
  geovp budget budget --root path/to/kitti
  geovp budget demo --method 'vo+prior + fusion' --limit 3
  geovp budget demo --method 'gt-3d + fusion' --limit 3 --sensitivity
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from geovp_benchmarks.cli.options import Lines, shared

if TYPE_CHECKING:
    from geovp_benchmarks.tables.table_model import Table

ARGUMENTS = {
    "": shared("matrix"),
    "method and clips": shared("--method", "--root", "--limit", "--set"),
    "budget": {
        "--stereo": "Use the depth of right images where no depth is recorded.",
        "--sensitivity": "Print the changes by constant offsets of the true poses.",
    },
}


def run(args: argparse.Namespace) -> Lines:
    """Print the tables."""
    from geovp_benchmarks.tables.formats import markdown

    yield from map(markdown, tables(args))


def tables(args: argparse.Namespace) -> list[Table]:
    """Return a table per metric."""
    from geovp_benchmarks.error_budget import changes
    from geovp_benchmarks.matrix import schema
    from geovp_classic.types import PrivilegedInput

    matrix = schema.read(args.matrix, args.set).override(root=args.root)
    needs = PrivilegedInput.RIGHT_FRAMES if args.stereo else PrivilegedInput.NONE
    method = changes.read_method(matrix, args.method, args.limit, needs)
    measure = changes.pose_sensitivity if args.sensitivity else changes.error_budget
    return measure(method)
