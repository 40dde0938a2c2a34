"""Score predictions of other software, next to the methods of a matrix.

For a clip "03/000180" the folder holds 03/000180.npz with `frames` (uint8 [F, H, W, 3], or
[S, F, H, W, 3] for samples), a folder 03/000180 of F images, or 03/000180.mp4. Names, sizes and
observed frames of the clips follow from the protocol.

Examples:
  geovp score predictions --protocol fvs20 --root path/to/kitti_raw --label DMVFN
  geovp score predictions --protocol my-matrix.toml --samples 10
"""

import argparse
from pathlib import Path

from geovp_benchmarks.cli.options import LinesAndCode, option, shared

ARGUMENTS = {
    "": {"predictions FOLDER": "Folder with a file or folder of frames for each clip."},
    "protocol": {
        "--protocol NAME": option(
            "Protocol, see `geovp list protocols`, or matrix with the clips and metrics.",
            type=Path,
            required=True,
        ),
        **shared("--root", "--limit", "--set"),
    },
    "submission": {
        "--label NAME": "Name of the method in tables. Default: name of the folder.",
        "--samples N = 1": "Number of samples of each clip.",
        "--poses FOLDER": "Poses of each clip in the format of KITTI or TUM. Default: none.",
    },
    "execution": shared("--workers", "--device"),
    "output": {"--out DIR": "Folder for the results. Default: results/PROTOCOL."},
}


def run(args: argparse.Namespace) -> LinesAndCode:
    """Score the predictions, and print the tables of the folder."""
    from geovp_benchmarks.cli.run import conclude
    from geovp_benchmarks.matrix import files, papers, schema
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.running.plan import Plan
    from geovp_benchmarks.running.run import run as run_matrix
    from geovp_classic import registry
    from geovp_classic.errors import BadData

    name, content = files.read(args.protocol, args.set)
    content = {**papers.expanded(content)}
    label = args.label or args.predictions.resolve().name
    submission = {"name": "recorded", "path": str(args.predictions.resolve())}
    submission |= {"num_samples": args.samples}
    if args.poses:
        submission["poses"] = str(args.poses.resolve())
    # Submissions stand beside the others: none replaces a method of the matrix or of the folder.
    results = Results(args.out or Path("results") / name)
    stored = results.by_name().get(label) if results.begun else None
    if label in content.get("predictors", {}) or (
        stored and stored.asked.get("predictor", {}).get("path") != submission["path"]
    ):
        raise BadData(f"{results.root} has another method {label!r}: give another --label or --out")
    content["predictors"] = {**content.get("predictors", {}), label: submission}
    matrix = schema.parse(name, content).select(label)
    plan = Plan(matrix.override(root=args.root, device=args.device), results, args.limit)
    run_matrix(plan, registry.build("executors", args.workers))
    return (yield from conclude(results))
