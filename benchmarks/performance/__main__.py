"""The page of speed: all measurements of this package in one run.

`PYTHONPATH=benchmarks python -m performance [ROUNDS] [--kitti ROOT SEQUENCE] [--out PAGE.md]`, on a
quiet machine. The first clip after an installation is measured in a process whose cache of compiled
code is empty. The comparison is a second such process, which finds the code compiled.
"""

import datetime
import io
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from pathlib import Path

import geovp_classic
from performance import COMMAND, clip, libraries, rounds_parser, scoring, splat

SOURCES = str(Path(__file__).parents[1])  # the folder that holds this package


def printed(main: Callable[[Sequence[str]], None], arguments: Sequence[str]) -> str:
    """Return what a measurement prints."""
    with redirect_stdout(io.StringIO()) as text:
        main(arguments)
    return text.getvalue().strip()


def first_clips(arguments: Sequence[str]) -> str:
    """Return the time of the first round of a new process, with an empty and with a full cache of
    compiled code.
    """
    command = [sys.executable, "-m", clip.__name__, "1", *arguments]
    paths = os.pathsep.join(filter(None, (SOURCES, os.environ.get("PYTHONPATH"))))
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"NUMBA_CACHE_DIR": cache, "PYTHONPATH": paths}
        runs = [
            subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
            for _ in range(2)
        ]
    names = "after installation", "compiled before"
    return "\n".join(
        f"{name}: {run.stdout.splitlines()[-1]}" for name, run in zip(names, runs, strict=True)
    )


def page(rounds: str, data: Sequence[str], shown: str) -> str:
    """Return the page of all measurements; `shown` is the command line that it names."""
    sections = {
        "A clip, of the square alone": printed(clip.main, [rounds, *data]),
        "A clip, of uncropped frames": printed(clip.main, [rounds, "--full", *data]),
        "The first clip": first_clips(data),
        "Scoring": printed(scoring.main, [rounds]),
        "Rendering": printed(splat.main, [rounds]),
        "Solvers": printed(libraries.main, [rounds]),
    }
    made = (
        f"Computed on {datetime.date.today()} with geovp {geovp_classic.__version__}, on "
        f"{os.cpu_count()} cores."
    )
    text = "\n\n".join(f"## {title}\n\n```text\n{lines}\n```" for title, lines in sections.items())
    return f"# Speed\n\n```sh\n{COMMAND} performance {shown}\n```\n\n{made}\n\n{text}\n"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page, or write it."""
    parser = rounds_parser("performance", "All measurements of speed, as a page.", 8)
    clip.add_kitti(parser)
    parser.add_argument(
        "--out", type=Path, metavar="PAGE.md", help="Write the page to this file. Default: print."
    )
    args = parser.parse_args(arguments)
    data = ["--kitti", *args.kitti] if args.kitti else []
    shown = f"{args.rounds}" + (f" --kitti path/to/kitti '{args.kitti[1]}'" if args.kitti else "")
    text = page(str(args.rounds), data, shown)
    print(text) if args.out is None else args.out.write_text(text)


if __name__ == "__main__":
    main()
