"""The page of speed: every measurement of this package in one run.

`python -m performance [ROUNDS] [--kitti ROOT SEQUENCE] [--out PAGE.md]`: to be run on a quiet
machine. The first clip after an installation is measured in a process whose cache of compiled code
is empty; its rival is the same process once more, which finds the code compiled.
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
from performance import clip, libraries, rounds_parser, scoring, splat


def printed(main: Callable[[Sequence[str]], None], arguments: Sequence[str]) -> str:
    """What a measurement prints."""
    with redirect_stdout(io.StringIO()) as text:
        main(arguments)
    return text.getvalue().strip()


def first_clips(arguments: Sequence[str]) -> str:
    """The first round in a new process, without and with compiled code in the cache."""
    command = [sys.executable, "-m", clip.__name__, "1", *arguments]
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"NUMBA_CACHE_DIR": cache}
        runs = [
            subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
            for _ in range(2)
        ]
    names = "after installation", "compiled before"
    return "\n".join(
        f"{name}: {run.stdout.splitlines()[-1]}" for name, run in zip(names, runs, strict=True)
    )


def page(rounds: str, data: Sequence[str], shown: str) -> str:
    """The page, of all measurements; `shown` stands for the arguments."""
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
    return f"# Speed\n\n```sh\npython -m performance {shown}\n```\n\n{made}\n\n{text}\n"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page, or write it."""
    parser = rounds_parser("Every measurement of speed, as a page.", 8)
    parser.add_argument(
        "--kitti", nargs=2, metavar=("ROOT", "SEQUENCE"), help="instead of the synthetic street"
    )
    parser.add_argument("--out", type=Path, metavar="PAGE.md", help="in place of printing it")
    chosen = parser.parse_args(arguments)
    data = ["--kitti", *chosen.kitti] if chosen.kitti else []
    shown = f"{chosen.rounds}" + (
        f" --kitti path/to/kitti '{chosen.kitti[1]}'" if chosen.kitti else ""
    )
    text = page(str(chosen.rounds), data, shown)
    print(text) if chosen.out is None else chosen.out.write_text(text)


if __name__ == "__main__":
    main()
