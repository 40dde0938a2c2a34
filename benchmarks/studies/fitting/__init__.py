"""Fit the forecasters' constants to recorded poses, as in the files that the wheel holds."""

import argparse
from collections.abc import Iterator

ARGUMENTS = {
    "": {
        "model motion-prior|body-motion|kalman": (
            "What to fit. The first two write MODEL.npz, the last prints its constants."
        ),
        "poses FOLDER": "Folder of NN.txt and NN_times.txt.",
        "--sequences NN... = 00 02 08 09": "Sequences of KITTI odometry.",
    }
}


def run(args: argparse.Namespace) -> Iterator[str]:
    """Fit a model; yield its constants or its file."""
    import numpy as np

    from geovp_benchmarks.trajectories import forecasting
    from geovp_classic.forecasting.kalman import fitted
    from studies.fitting import body_motion, kalman, motion_prior
    from studies.fitting.windows import cut, joined

    if args.model == "kalman":
        windows = forecasting.read_windows(args.poses, args.sequences, stride=200)
        for name in ("turn-rate", "acceleration", "acceleration-damped"):
            yield f"{name}: {kalman.fit(windows, fitted(name))}"
        return
    drives = forecasting.read_sequences(args.poses, args.sequences).values()
    sequences = [cut(drive) for drive in drives]
    if args.model == "body-motion":
        arrays = body_motion.fit(joined(sequences))
    else:
        arrays = motion_prior.arrays_of(motion_prior.PriorFit().fit(sequences))
    np.savez(f"{args.model}.npz", allow_pickle=False, **arrays)
    yield f"written to {args.model}.npz"
