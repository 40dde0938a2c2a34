"""The command line of the learned parts: `python -m geovp_learned train METHOD CONFIG.toml`, and
model cards.
"""

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from geovp_classic.errors import GeovpError

CHANGES = ("variant", "seed", "precision")  # options that change a config


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a training; return 0 if it is finished, 1 if it was interrupted, 2 for bad input."""
    options = _parser().parse_args(arguments)
    try:
        return options.run(options)
    except GeovpError as error:
        print(f"python -m geovp_learned: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m geovp_learned", description="Train the learned parts."
    )
    verbs = parser.add_subparsers(required=True)

    # Train a method by a config, whose settings the options replace
    train = verbs.add_parser("train", help="train a method")
    train.set_defaults(run=_train, limit_seconds=math.inf)
    train.add_argument("method", help="deepvo, synsin, svg, srvp, slamp")
    train.add_argument(
        "config",
        type=Path,
        metavar="CONFIG.toml",
        help="a training config, or the name of a shipped one",
    )
    options: Sequence[tuple[str, type, str]] = (
        ("--out", Path, "folder of the run (default: runs/CONFIG[-VARIANT][-SEED])"),
        ("--root", Path, "root of the data sets, in place of the config's"),
        ("--variant", str, "one of the config's [variants]"),
        ("--seed", int, "in place of the config's"),
        ("--precision", str, "in place of the config's, as in Lightning Fabric, such as 32-true"),
        ("--limit-seconds", float, "stop after so many seconds of training"),
    )
    for name, kind, text in options:
        train.add_argument(name, type=kind, help=text)
    train.add_argument(
        "--resume", action="store_true", help="go on with the run in the folder, if there is one"
    )

    # Convert the authors' files
    convert = verbs.add_parser(
        "convert",
        help="convert the authors' weights; nothing in their file is executed",
        epilog="See docs/guide/official-weights.md for the files and their protocols.",
    )
    convert.set_defaults(run=_convert)
    convert.add_argument("file", type=Path, metavar="FILE", help="as the authors publish it")
    convert.add_argument("--method", required=True, choices=("synsin", "svg", "srvp", "slamp"))
    convert.add_argument("--out", type=Path, help="default: FILE with the ending .safetensors")

    # Describe a weights file
    card = verbs.add_parser("card", help="print the model card of a weights file")
    card.set_defaults(run=_card)
    card.add_argument("weights", type=Path, metavar="WEIGHTS.safetensors")
    card.add_argument("--log", type=Path, help="the run's metrics.csv; adds its curves")
    return parser


def _card(options: argparse.Namespace) -> int:
    from geovp_learned import model_cards

    print(model_cards.model_card(options.weights, options.log), end="")
    return 0


def _convert(options: argparse.Namespace) -> int:
    from geovp_learned.convert import convert

    out = options.out or options.file.with_suffix(".safetensors")
    dropped = convert(options.file, options.method, out)
    print(
        f"wrote {out} and {out.with_suffix('.md').name}; dropped: {', '.join(dropped) or 'nothing'}"
    )
    return 0


def _train(options: argparse.Namespace) -> int:
    from geovp_learned import training_config
    from geovp_learned.training import WEIGHTS, train

    given = {name: getattr(options, name) for name in CHANGES}
    changes = {name: value for name, value in given.items() if value is not None}
    config = training_config.load(options.method, options.config, options.root, **changes)
    name = "-".join(map(str, (options.config.stem, *changes.values())))
    folder = options.out or Path("runs") / name
    run = train(config, folder, resume=options.resume, limit_s=options.limit_seconds)
    progress = run.progress
    if run.fabric.is_global_zero:
        state = "finished" if run.is_finished else "stopped (go on with --resume)"
        print(
            f"{state} after {progress.step} steps and {progress.seconds:.0f} s; "
            f"best score {progress.best_score:.5g} at step {progress.best_step}: "
            f"{folder / WEIGHTS}"
        )
    return 0 if run.is_finished else 1


if __name__ == "__main__":
    sys.exit(main())
