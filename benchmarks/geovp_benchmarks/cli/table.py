"""Print and write the tables of a results folder.

Tables of a selection are printed only. --format tex needs the packages booktabs and graphicx.

Examples:
  geovp table results/demo
  geovp table results/demo --against copy-last
  geovp table results/demo --steps 1 5 10 20 --metrics psnr
  geovp table results/demo --steps 1 5 10 20 --metrics psnr --against copy-last
  geovp table results/demo --per clip --methods copy-last --format csv
  geovp table results/demo --by turning --metrics psnr coverage --format tex
"""

import argparse
import os

from geovp_benchmarks.cli.messages import terminal_width
from geovp_benchmarks.cli.options import SELECTION, Lines, option, shared
from geovp_classic.errors import BadData

ARGUMENTS = {
    "": shared("folder"),
    "selection": {
        **SELECTION,
        "--steps NUMBER...": "Scores of these steps alone. Default: means over all steps.",
        "--per clip": option(
            "A row for each clip, the worst first. Default: means over clips.", choices=["clip"]
        ),
        "--seeds": (
            "Average methods that differ by a number at the end of a name, such as net-0 and "
            "net-1: training seeds, whose variance enters the intervals."
        ),
        "--strict": "Leave out clips on which a method failed.",
        "--paper NAME": "Layout of a paper, next to its numbers, such as fvs20. Default: ours.",
    },
    "output": {
        "--format md|tex|csv = md": "Format.",
        "--spread interval|standard-error = interval": "Uncertainty of each mean.",
        "--label NAME": "Label of the first LaTeX table. Default: tab:TABLE.",
        "--caption TEXT": "Caption of the first LaTeX table. Default: its title.",
    },
}

# Options that another one leaves without effect.
EXCLUDED = {
    "per": ("paper", "against", "steps", "seeds", "strict", "spread", "label", "caption"),
    "paper": ("metrics", "by", "against", "steps", "seeds", "strict", "spread"),
}


def run(args: argparse.Namespace) -> Lines:
    """Print the tables; write them if nothing was selected."""
    for name in (name for name in EXCLUDED if getattr(args, name)):
        for other in EXCLUDED[name]:
            if getattr(args, other) not in (None, False, [], "interval"):
                raise BadData(f"--{name} does not go with --{other}: leave out one of them")
    if args.per and args.format == "tex":
        raise BadData("--per clip has no --format tex: give md or csv")
    # starting threads and looking for plug-ins take a tenth of the time of a table
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "1")
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.tables import clips, formats, tables

    results = Results(args.folder).select(*args.methods)
    groups = [results]
    if args.by:
        from geovp_benchmarks.statistics import strata

        groups = strata.divide(results, args.by)
    if args.per:
        tables.scored_methods(results)
        for group in groups:
            lines = clips.per_clip(group, args.metrics)
            if not lines:
                raise BadData(f"{results.root} has no scores: run it, or give other --metrics")
            if args.format == "csv":
                yield formats.comma_separated_lines(lines)
                continue
            heading = f"## {group.protocol()['name']}: clips, the worst first"
            yield "\n".join([heading, *formats.blocks(clips.rounded(lines), terminal_width()), ""])
        return
    selection = tables.Selection(
        metrics=args.metrics, steps=args.steps, strict=args.strict, has_seeds=args.seeds
    )
    if args.paper:
        from geovp_benchmarks.tables import published

        shown = published.build(results, args.paper)
    elif args.against:
        shown = [tables.against(group, args.against, args.spread, **selection) for group in groups]
        if not any(table.rows for table in shown):
            raise BadData(f"no other method to compare with {args.against}: select or run some")
    elif args.by:
        shown = [tables.build(group, args.spread, **selection)[0] for group in groups]
    else:
        shown = tables.build(results, args.spread, **selection)
        if not (args.methods or args.metrics or args.strict or args.steps or args.seeds):
            formats.write_all(results, shown)
    match args.format:
        case "csv":
            texts = [formats.comma_separated(table) for table in shown]
        case "tex":
            first = formats.latex(shown[0], args.caption or "", args.label or "")
            texts = [first, *map(formats.latex, shown[1:])]
        case "md":
            texts = [formats.markdown(table, terminal_width()) for table in shown]
    yield "\n".join(texts)
