"""How much of the camera's motion past poses, and images, can foretell: shares of its variance by
horizon.

Against a constant turn of constant speed with the last height, pitch and roll: what is left by it
is the variance, and a share below 0 is worse than it. Whatever is fitted is asked about sequences
that it was not fitted to.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from geovp_benchmarks.arguments import positive
from geovp_benchmarks.evaluation.forecasting import TEST
from geovp_benchmarks.progress import Progress

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from geovp_benchmarks.analysis.intervals import Interval
    from geovp_classic.types import FloatArray

ALL = "00 01 02 03 04 05 06 07 08 09 10"
SIZES_PX = {
    "00[0:569)": 128,
    "00[600:725)": 128,
    "raw0095": 256,
    "03[0:180)": 256,
}  # train and val, and their crops
LEAST_SHARE = -1.0  # printed; what is far below is as useless
LEAST_NOISE = 0.05  # per cent that are printed
INTERVALS = (
    "In brackets 95 % intervals, block bootstrap within each sequence; `python "
    "benchmarks/studies coverage` says what they hold."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Pose files, images if there are any, and where the page goes."""
    parser.add_argument(
        "poses",
        type=Path,
        metavar="POSES_DIR",
        help="NN.txt, times in NN_times.txt or ../sequences",
    )
    parser.add_argument(
        "--sequences", nargs="+", default=TEST.split(), metavar="NN", help=f"asked about ({TEST})"
    )
    parser.add_argument(
        "--fit",
        nargs="+",
        default=ALL.split(),
        metavar="NN",
        help="fitted to, but for the one asked",
    )
    parser.add_argument(
        "--stride", type=positive, default=4, metavar="N", help="frames between two windows (4)"
    )
    parser.add_argument(
        "--root",
        type=Path,
        metavar="DIR",
        help="KITTI's images: what their depth adds is asked, too",
    )
    parser.add_argument(
        "--frames", nargs="+", metavar="FRAMES", help=f"of the images ({' '.join(SIZES_PX)})"
    )
    parser.add_argument(
        "--size", type=positive, default=256, metavar="PX", help="of the crops of --frames (256)"
    )
    parser.add_argument(
        "--page", type=Path, metavar="FILE", help="write the page; what is under its Notes stays"
    )


def run(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """The page's text, and with `--page` its file; BadData without windows."""
    from geovp_benchmarks.tables.formats import write_page

    lines = [
        *_poses(chosen, progress),
        *(_images(chosen, progress) if chosen.root is not None else ()),
    ]
    yield from lines
    if chosen.page is not None:
        command = (
            "python benchmarks/studies foreseeable path/to/poses"
            + " --root path/to/kitti" * (chosen.root is not None)
        )
        write_page(
            chosen.page,
            "What can be foreseen",
            [command],
            "the same with `--page`",
            "\n".join(lines),
        )


def _poses(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    import numpy as np

    from geovp_benchmarks.evaluation.forecasting.evaluation import read_sequences
    from geovp_benchmarks.tables.formats import grid
    from studies.foreseeable import learners, windows

    sequences = read_sequences(chosen.poses, list(dict.fromkeys([*chosen.sequences, *chosen.fit])))
    everything = windows.read(sequences, chosen.stride, progress)
    own = np.isin(everything.sequences, chosen.sequences)
    asked = everything[own]
    rows = {"constant velocity": asked.straight}
    for name, learner in learners.LEARNERS.items():
        rows[name] = learners.held_out(learner, everything, chosen.sequences, progress)[own]
    rows["motion prior, as shipped"] = asked.prior
    heads = [f"{step}" for step in windows.HORIZONS]
    yield from [
        "## By past poses",
        "",
        f"{len(asked)} windows of {', '.join(chosen.sequences)}, at 10 Hz.{SPREAD}",
        "",
    ]
    yield from grid([["root mean square at horizon", *heads], *_sizes(asked.truth, asked.noise)])
    yield from [
        "",
        f"Fraction of that variance that is explained, in per cent. {FITTED}\n{INTERVALS}",
        "",
    ]
    shares = [
        [
            f"{component}: {name}",
            *(_percent(one) for one in _shares(asked.truth, answer, asked.sequences, number)),
        ]
        for number, component in enumerate(windows.COMPONENTS)
        for name, answer in rows.items()
        if name != "constant velocity" or component in ("along", "across", "yaw")
    ]
    yield from grid([["component: by", *heads], *shares])


FITTED = """Each learner is fitted to all sequences except the one under test, left and right alike.
The shipped prior is fitted to 00, 02, 08 and 09. A network is an ensemble of small perceptrons."""
SPREAD = """
First the residual of a constant turn rate and velocity, in cm and degrees. In brackets is the
percentage of its variance that is noise of the recorded poses, which no forecast can explain.
That noise is estimated from sixth differences of the poses, beside a motion below 2 Hz. Noise that
lasts for several frames, as after a correction by satellite navigation, is not included. Windows
in which no car could have driven as recorded are left out."""


def _sizes(truth: FloatArray, noise: FloatArray) -> Iterator[list[str]]:
    import numpy as np

    from studies.foreseeable.windows import COMPONENTS

    sizes = np.sqrt((truth**2).mean(axis=0))
    share = (noise**2).mean(axis=0) / np.maximum(sizes**2, 1e-30)
    for number, component in enumerate(COMPONENTS):
        unit, factor = ("cm", 100.0) if number < 3 else ("degrees", float(np.degrees(1.0)))
        pairs = zip(factor * sizes[:, number], 100 * share[:, number], strict=True)
        yield [
            f"{component} ({unit})",
            *(
                f"{size:.3g} ({part:.2g})" if part > LEAST_NOISE else f"{size:.3g} (0)"
                for size, part in pairs
            ),
        ]


def _images(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    from geovp_benchmarks.tables.formats import grid
    from studies.foreseeable import images, windows

    sizes_px = dict.fromkeys(chosen.frames, chosen.size) if chosen.frames else SIZES_PX
    read = images.read(chosen.root, sizes_px, chosen.stride, progress)
    answers = {name: images.held_out(read, name) for name in images.CUES}
    found = {name: _shares(*pair, read.sequences) for name, pair in answers.items()}
    about = (
        f"{len(read.starts)} windows of {', '.join(sizes_px)}. Fraction of the shipped prior's "
        "squared error, in per cent,"
    )
    yield from [
        "",
        "## By depth of the last frames",
        "",
        f"{about} that a ridge regression on a cue explains.",
        "",
    ]
    rows = [
        [f"{name} -> {images.CUES[name].component}", *map(_percent, shares)]
        for name, shares in found.items()
    ]
    yield from grid(
        [["cue, and what it should tell", *(f"{step}" for step in windows.HORIZONS)], *rows]
    )
    yield from [
        "",
        f"Correlation with the prior's error at horizon {windows.HORIZONS[-1]}, by sequence:",
        "",
    ]
    tables = {name: images.correlations(read, name) for name in images.CUES}
    yield from (f"- {name}: {_listed(table)}" for name, table in tables.items() if table)
    nothing = [name for name, shares in found.items() if not any(share.low > 0 for share in shares)]
    yield from ["", f"Not different from nothing at any horizon: {', '.join(nothing) or 'none'}."]


def _shares(
    truth: FloatArray,
    answer: FloatArray,
    sequences: npt.NDArray[np.str_],
    number: int | None = None,
) -> list[Interval]:
    """The explained share at each horizon, of deviations [N, H, 6] and a component's number or of
    [N, H].
    """
    from studies.foreseeable.learners import explained

    if number is not None:
        truth, answer = truth[..., number], answer[..., number]
    return [explained(truth[:, step], answer[:, step], sequences) for step in range(truth.shape[1])]


def _percent(share: Interval) -> str:
    """In per cent, with the interval; a dash where nothing varies or windows are too few."""
    if math.isnan(share.low):
        return "-"
    mean, low, high = (
        str(round(100 * max(one, LEAST_SHARE))) for one in (share.mean, share.low, share.high)
    )
    return (
        f"{mean} [{low}, {high}]" if share.mean > LEAST_SHARE else f"below {100 * LEAST_SHARE:.0f}"
    )


def _listed(table: Mapping[str, float]) -> str:
    return ", ".join(f"{value:+.2f} on {name}" for name, value in table.items())
