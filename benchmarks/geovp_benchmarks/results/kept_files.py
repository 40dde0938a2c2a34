"""Kept clips and predictions as npz files: which arrays are in them; what is not so is refused by
name.
"""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from geovp_classic import files
from geovp_classic.data.atomic import write_bytes
from geovp_classic.errors import BadData
from geovp_classic.types import Clip, Intrinsics, Motion, Prediction, Trajectory

POSES = {"world_from_cam": ("f", 3), "past": ("f", 3), "futures": ("f", 4)}
TIMES = {"times_s": ("f", 1), "past_times_s": ("f", 1), "is_metric": ("b", 0)}
PREDICTION = {"frames": ("u1", 5), "covered": ("b", 4), "tracked": ("b", 1), **POSES, **TIMES}
PREDICTION |= {"scale_uncertainty": ("f", 0), "confidence": ("f", 2)}
CLIP = {
    "frames": ("u1", 4),
    "intrinsics": ("f", 1),
    "depths": ("f", 3),
    "moving": ("b", 3),
    **POSES,
    **TIMES,
}
CLIP |= {"camera_height_m": ("f", 0)}


def read_prediction(path: Path) -> Prediction:
    """Frames [S, F, H, W, 3], covered [S, F, H, W] or None, motion or None."""
    arrays = read_arrays(path, PREDICTION, "frames")
    motion = None
    if "futures" in arrays:
        uncertainty = float(arrays["scale_uncertainty"]) if "scale_uncertainty" in arrays else None
        past = Trajectory(
            arrays["past"], arrays["past_times_s"], bool(arrays["is_metric"]), uncertainty
        )
        motion = Motion(past, arrays["futures"], arrays["tracked"])
    return Prediction(arrays["frames"], arrays.get("covered"), motion, arrays.get("confidence"))


def write_prediction(path: Path, prediction: Prediction) -> None:
    """Keep a prediction."""
    arrays: dict[str, Any] = {
        "frames": prediction.frames,
        "covered": prediction.covered,
        "confidence": prediction.confidence,
    }
    if prediction.motion is not None:
        past = prediction.motion.past
        arrays |= {
            "past": past.world_from_cam,
            "past_times_s": past.times_s,
            "is_metric": past.is_metric,
        }
        arrays |= {"futures": prediction.motion.futures, "tracked": prediction.motion.tracked}
        arrays["scale_uncertainty"] = past.scale_uncertainty
    _write(path, arrays)


def read_clip(path: Path, name: str) -> Clip:
    """Frames, camera, trajectory, depths, moving; never wide or right frames."""
    arrays = read_arrays(path, CLIP, "frames", "times_s", "intrinsics")
    fx, fy, cx, cy, width, height = arrays["intrinsics"].tolist()
    trajectory = None
    if "world_from_cam" in arrays:
        trajectory = Trajectory(
            arrays["world_from_cam"], arrays["times_s"], bool(arrays["is_metric"])
        )
    return Clip(
        name=name,
        frames=arrays["frames"],
        times_s=arrays["times_s"],
        intrinsics=Intrinsics(fx, fy, cx, cy, int(width), int(height)),
        trajectory=trajectory,
        depths=arrays.get("depths"),
        moving=arrays.get("moving"),
        camera_height_m=float(arrays["camera_height_m"]) if "camera_height_m" in arrays else None,
    )


def write_clip(path: Path, clip: Clip) -> None:
    """Keep a clip, so that images and new scores need no data set."""
    camera = clip.intrinsics
    numbers = (
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        camera.width_px,
        camera.height_px,
    )
    arrays: dict[str, Any] = {
        "frames": clip.frames,
        "times_s": clip.times_s,
        "intrinsics": np.array(numbers),
    }
    if clip.trajectory is not None:
        arrays |= {
            "world_from_cam": clip.trajectory.world_from_cam,
            "is_metric": clip.trajectory.is_metric,
        }
    arrays |= {name: getattr(clip, name) for name in ("depths", "moving", "camera_height_m")}
    _write(path, arrays)


def is_whole(path: Path) -> bool:
    """Whether a file is as it was written."""
    try:
        files.read_npz(path)
    except BadData:
        return False
    return True


def read_arrays(path: Path, kinds: Mapping[str, tuple[str, int]], *needed: str) -> dict[str, Any]:
    """The arrays of a file, each of the kind and number of axes that `kinds` says; BadData when one
    is not or lacks.
    """
    if not path.exists():
        raise BadData(
            f"{path} does not exist: only the predictions of a few clips are kept, see --keep"
        )
    found = files.read_npz(path)
    for name, array in found.items():
        kind, axes = kinds.get(name, ("", 0))
        own = "f" if array.dtype.kind in "fiu" and kind == "f" else array.dtype.kind
        right = kind in (own, array.dtype.str[1:]) and array.ndim == axes
        if not right or (kind == "f" and name != "depths" and not np.isfinite(array).all()):
            expected = f"{kind} with {axes} axes, finite" if kind else f"one of {', '.join(kinds)}"
            raise BadData(
                f"{path}: {name} is {array.dtype} {array.shape}, expected {expected}: remove "
                "it, run again"
            )
    given = [name for name in ("past", "past_times_s", "futures", "tracked") if name in found]
    lacking = [name for name in needed if name not in found]
    if (
        lacking
        or len(given) not in (0, 4)
        or (len(given) == 4 or "world_from_cam" in found) != ("is_metric" in found)
    ):
        raise BadData(
            f"{path} holds {', '.join(found) or 'nothing'} and lacks the rest: remove it and "
            "run again"
        )
    if len(found.get("intrinsics", range(6))) != 6:
        raise BadData(
            f"{path}: {len(found['intrinsics'])} intrinsics, expected 6: remove it and run again"
        )
    return found


def _write(path: Path, arrays: Mapping[str, Any]) -> None:
    """All arrays but those that are None."""
    stream = (
        io.BytesIO()
    )  # a zip file that cannot be finished on a full disk complains once more when it is closed
    np.savez_compressed(
        stream, **{name: array for name, array in arrays.items() if array is not None}
    )
    write_bytes(path, stream.getvalue())
