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

from geovp_benchmarks.cli.options import Lines, Progress, add_options, shared

if TYPE_CHECKING:
    from geovp_benchmarks.tables.table_model import Table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the method, the clips and what is replaced."""
    add_options(parser, shared("matrix"))
    clips = shared("--method", "--root", "--limit", "--set")
    add_options(parser, clips, "method and clips")
    budget = {
        "--stereo": "Use the depth of right images where no depth is recorded.",
        "--sensitivity": "Print the changes by constant offsets of the true poses.",
    }
    add_options(parser, budget, "budget")


def run(args: argparse.Namespace, progress: Progress) -> Lines:
    """Print the tables."""
    from geovp_benchmarks.tables.formats import markdown

    yield from map(markdown, tables(args, progress))


def tables(args: argparse.Namespace, progress: Progress) -> list[Table]:
    """Return a table per metric."""
    from geovp_benchmarks.evaluation import error_budget
    from geovp_benchmarks.matrix import schema
    from geovp_classic.types import PrivilegedInput

    matrix = schema.read(args.matrix, args.set).override(root=args.root)
    needs = PrivilegedInput.RIGHT_FRAMES if args.stereo else PrivilegedInput.NONE
    method = error_budget.read_method(matrix, args.method, args.limit, needs)
    measure = error_budget.pose_sensitivity if args.sensitivity else error_budget.error_budget
    return measure(method, progress)
