"""Image cues for the yaw, pitch and roll that the motion prior misses, cross-validated by road.

Cues are measured in the last of ten observed frames and in its multi-view depth with the recorded
poses. A ridge regression on a cue is fitted to all roads but one and predicts the prior's residual
on that one; its penalty is selected in the same way among the roads that it is fitted to. The study
prints the fraction of the mean square residual that is explained, with 95 % intervals.
"""

import argparse
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from geovp_benchmarks.cli.options import add
from geovp_benchmarks.progress import Progress, tracked
from geovp_benchmarks.tables.formats import grid
from geovp_classic import registry
from geovp_classic.data.windows import cut
from geovp_classic.depth.multiview import Multiview
from geovp_classic.errors import BadData
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.geometry import pinhole
from geovp_classic.geometry.robust import irls
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.types import Clip, FloatArray, PrivilegedInput
from studies.fitting.windows import drivable_steps
from studies.predictability import (
    COMPONENTS,
    deviations,
    explained_fraction,
    percent,
    planar_states,
)

NUM_PAST = 10
HORIZONS = np.array([1, 5, 10, 15, 20])
SIZE_PX = (416, 128)  # whole frames, as large as the smallest that come with the splits


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the images and their split."""
    add(parser, "root", "FOLDER", "Folder of KITTI odometry, with images and poses.")
    add(parser, "--splits", "NAME", "Splits. Default: train val.", ("train", "val"), nargs="+")
    add(parser, "--stride", "N", "Frames between the starts of two windows. Default: 5.", 5)


def run(args: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """Yield a table with a row per cue."""
    windows = read(Path(args.root), args.splits, args.stride, progress)
    roads, counts = np.unique(windows.roads, return_counts=True)
    if len(roads) < 3:
        raise BadData(f"windows of {len(roads)} roads, expected 3 or more: give other splits")
    yield ", ".join(f"{count} windows of {road}" for road, count in zip(roads, counts, strict=True))
    yield ""
    lines = [["explained (%), 95 % interval", *map(str, HORIZONS), "roads above 0 at 20"]]
    for component, cues in windows.cues.items():
        residual = windows.residuals[..., COMPONENTS.index(component)]
        sizes = np.degrees(np.sqrt((residual**2).mean(axis=0)))
        lines.append([f"{component}: residual (deg)", *(f"{size:.3g}" for size in sizes), ""])
        if len(cues) > 1:
            cues = {**cues, "all of these": np.concatenate(list(cues.values()), axis=1)}
        for name, values in cues.items():
            predicted = CrossValidation().predict(values, residual, windows.roads)
            fractions = [
                percent(explained_fraction(residual[:, step], predicted[:, step], windows.roads))
                for step in range(len(HORIZONS))
            ]
            gain = residual[:, -1] ** 2 - (residual[:, -1] - predicted[:, -1]) ** 2
            num_gains = sum(gain[windows.roads == road].mean() > 0 for road in roads)
            lines.append([f"{component}: {name}", *fractions, f"{num_gains} of {len(roads)}"])
    yield from grid(lines)


@dataclass(frozen=True)
class Scene:
    """Last observed frame, with the forecast of the motion prior."""

    grey: FloatArray  # [H, W], in [0, 1]
    inverse_depth: FloatArray  # [H, W], per metre
    rays: FloatArray  # [H, W, 3]
    ground: FloatArray  # [3], normal over height: inverse depth of the road = ground @ ray
    path: FloatArray  # [F, 3], forecast positions in the last camera
    travel: FloatArray  # [3], direction of the past motion in the last camera

    @property
    def height_m(self) -> float:
        """Return the height of the camera above the road."""
        return float(1 / np.linalg.norm(self.ground))

    @property
    def elevation_m(self) -> FloatArray:
        """Return the height [H, W] of the visible points above the road."""
        depth_m = 1 / np.maximum(self.inverse_depth, 1e-3)
        return self.height_m * (1 - self.rays @ self.ground * depth_m)


def thumbnail(image: FloatArray) -> FloatArray:
    """Reduce an image to 6 x 16 numbers of mean 0 and deviation 1."""
    small = cv2.resize(image, (16, 6), interpolation=cv2.INTER_AREA)
    return np.asarray((small - small.mean()) / (small.std() + 1e-6))


def left_minus_right(image: FloatArray) -> FloatArray:
    """Return what changes its sign in a mirror [48]."""
    small = thumbnail(image)
    return np.asarray((small - small[:, ::-1])[:, :8].ravel())


def left_plus_right(image: FloatArray) -> FloatArray:
    """Return what stays the same in a mirror [48]."""
    small = thumbnail(image)
    return np.asarray((small + small[:, ::-1])[:, :8].ravel())


def free_arcs(scene: Scene) -> FloatArray:
    """Return the additional yaw [1] whose arcs pass far from obstacles, in radians.

    Arcs deviate from the forecast path and are weighted by the obstacles within 1.5 m of them.
    """
    is_obstacle = (scene.elevation_m > 0.4) & (scene.elevation_m < 2.5)
    is_obstacle &= scene.inverse_depth > 1 / 60
    obstacles = (scene.rays / np.maximum(scene.inverse_depth, 1e-3)[..., None])[is_obstacle][::4]
    length_m = np.cumsum(np.linalg.norm(np.diff(scene.path, axis=0, prepend=0.0), axis=1))
    if length_m[-1] < 1 or not len(obstacles):
        return np.zeros(1)
    yaws = np.radians(np.linspace(-25, 25, 21))
    costs = []
    for yaw in yaws:
        right_m = scene.path[:, 0] + yaw * length_m**2 / (2 * length_m[-1])
        across_m = obstacles[:, :1] - right_m
        distance_m = np.hypot(across_m, obstacles[:, 2:] - scene.path[:, 2]).min(axis=1)
        # a point far away stands for a larger surface
        areas = np.maximum(1 - distance_m / 1.5, 0) @ (obstacles[:, 2] / 10) ** 2
        costs.append(abs(yaw) / np.radians(4) + 500 * areas / scene.grey.size)
    weights = np.exp(np.min(costs) - costs)
    return np.array([weights @ yaws / weights.sum()])


def height_profile(scene: Scene) -> FloatArray:
    """Return the median height [7] of the road along the forecast path, in metres, 0 if unseen."""
    depth_m = 1 / np.maximum(scene.inverse_depth, 1e-3)
    centre_m = np.interp(depth_m, scene.path[:, 2], scene.path[:, 0])
    is_road = np.abs(scene.rays[..., 0] * depth_m - centre_m) < 2.5
    is_road &= np.abs(scene.elevation_m) < 0.6
    heights = []
    for near_m, far_m in itertools.pairwise([6, 8, 10, 13, 16, 20, 26, 34]):
        values = scene.elevation_m[is_road & (depth_m >= near_m) & (depth_m < far_m)]
        heights.append(np.median(values) if len(values) > 15 else 0.0)
    return np.array(heights)


def road_pitch(scene: Scene) -> FloatArray:
    """Return the angle [1] between the road ahead and the direction of travel, in radians."""
    return np.array([scene.ground @ scene.travel * scene.height_m])


def road_roll(scene: Scene) -> FloatArray:
    """Return the camera's roll [1] over the road ahead, in radians."""
    return np.array([np.arctan2(scene.ground[0], scene.ground[1])])


Cue = Callable[[Scene], FloatArray]
CUES: Mapping[str, Mapping[str, Cue]] = {  # by the component that they may predict
    "yaw": {
        "image, left minus right": lambda scene: left_minus_right(scene.grey),
        "inverse depth, left minus right": lambda scene: left_minus_right(scene.inverse_depth),
        "free arcs": free_arcs,
    },
    "pitch": {
        "image": lambda scene: left_plus_right(scene.grey),
        "inverse depth": lambda scene: left_plus_right(scene.inverse_depth),
        "pitch of the road": road_pitch,
        "height profile of the road": height_profile,
    },
    "roll": {"roll over the road": road_roll},
}


@dataclass(frozen=True)
class CueWindows:
    """N windows of images."""

    cues: Mapping[str, Mapping[str, FloatArray]]  # [N, C] each, by component and name
    residuals: FloatArray  # [N, H, 6], recorded less forecast deviation
    roads: npt.NDArray[np.str_]  # [N]


@single_threaded_blas
def read(root: Path, splits: Sequence[str], stride: int, progress: Progress) -> CueWindows:
    """Return the windows that a car can have driven and that show a road; BadData if none does."""
    scenes = []
    residuals = []
    roads = []
    num_frames = NUM_PAST + int(HORIZONS[-1])
    for split in splits:
        spec = {"name": "kitti", "root": str(root), "split": split, "num_frames": num_frames}
        dataset = registry.build("datasets", spec)
        is_drivable = {
            name: drivable_steps(recording.trajectory)
            for name, recording in dataset.recordings.items()
        }
        starts = [
            (stretch.sequence, first)
            for stretch in dataset.ranges
            for first in stretch.starts(num_frames, stride)
        ]
        for road, first in tracked(starts, len(starts), progress):
            if not is_drivable[road][first : first + num_frames - 1].all():
                continue
            clip = cut(dataset.recordings[road], first, num_frames, SIZE_PX)
            scene, residual = _window(clip)
            if scene is not None:
                scenes.append(scene)
                residuals.append(residual)
                roads.append(road)
    if not scenes:
        raise BadData(f"{root}: no window of {', '.join(splits)} shows a road: give other splits")
    cues = {
        component: {name: np.stack(list(map(cue, scenes))) for name, cue in by_name.items()}
        for component, by_name in CUES.items()
    }
    return CueWindows(cues, np.stack(residuals), np.array(roads))


def _window(clip: Clip) -> tuple[Scene | None, FloatArray]:
    """Return the scene, None if no road is visible, and the prior's residuals [H, 6]."""
    assert clip.trajectory is not None
    context, _ = clip.split(NUM_PAST, PrivilegedInput.PAST_POSES)
    past = clip.trajectory[:NUM_PAST]
    forecast = MotionPrior().forecast(past, clip.times_s[NUM_PAST:])[0]
    base = planar_states(forecast, past)[HORIZONS - 1]
    recorded, predicted = (
        deviations(poses[HORIZONS - 1], past, base)
        for poses in (clip.trajectory.world_from_cam[NUM_PAST:], forecast)
    )
    residual = recorded - predicted
    inverse_depths, confidence = Multiview().inverse_depths(context, past)
    rays = pinhole.rays(clip.intrinsics)
    ground = fit_ground(inverse_depths[-1], confidence[-1], rays)
    if ground is None:
        return None, residual
    last_from_world = np.linalg.inv(past.world_from_cam[-1])
    moved = -(last_from_world @ past.world_from_cam[0])[:3, 3]
    path = (last_from_world @ forecast)[:, :3, 3]
    travel = moved / max(float(np.linalg.norm(moved)), 1e-6)
    grey = context.frames[-1].mean(axis=2) / 255
    return Scene(grey, inverse_depths[-1], rays, ground, path, travel), residual


def fit_ground(
    inverse_depth: FloatArray,  # [H, W]
    confidence: FloatArray,  # [H, W]
    rays: FloatArray,  # [H, W, 3]
    max_residual: float = 0.01,  # per metre
    min_pixels: int = 300,
) -> FloatArray | None:
    """Fit the normal [3] over the height of the road to confident pixels in front of the camera.

    Returns None if too few of them lie on a plane below a camera.
    """
    is_ahead = (np.abs(rays[..., 0]) < 0.3) & (rays[..., 1] > 0.06) & (confidence > 0.2)
    points, target = rays[is_ahead], inverse_depth[is_ahead]
    ground = irls(
        np.array([0.0, 1 / 1.65, 0.0]),
        lambda plane: (points @ plane - target, points),
        np.add,
        scale=max_residual,
    )
    is_inlier = np.abs(points @ ground - target) < max_residual
    is_plausible = 1 < 1 / np.linalg.norm(ground) < 2.5  # metres
    return ground if is_inlier.sum() >= min_pixels and is_plausible else None


@dataclass(frozen=True)
class CrossValidation:
    """Ridge regression that leaves one road out, also to select its penalty."""

    penalties: tuple[float, ...] = (0.1, 1.0, 10.0, 100.0)  # per window

    def predict(
        self,
        cue: FloatArray,  # [N, C]
        residual: FloatArray,  # [N, H]
        roads: npt.NDArray[np.str_],  # [N]
    ) -> FloatArray:
        """Return the predicted residual [N, H] of each road by regressions on all others."""
        # how the camera is mounted on a road is not a cue
        means = {road: cue[roads == road].mean(axis=0) for road in np.unique(roads)}
        centred = cue - np.stack([means[road] for road in roads])
        predicted = np.zeros_like(residual)
        for road in np.unique(roads):
            others = roads != road
            inner = centred[others], residual[others], roads[others]
            scale = (inner[1] ** 2).mean(axis=0)
            errors = [
                ((inner[1] - leave_one_out(*inner, penalty)) ** 2 / scale).mean()
                for penalty in self.penalties
            ]
            penalty = self.penalties[int(np.argmin(errors))]
            predicted[~others] = ridge(*inner[:2], penalty, centred[~others])
        return predicted


def leave_one_out(
    cue: FloatArray, residual: FloatArray, roads: npt.NDArray[np.str_], penalty: float
) -> FloatArray:
    """Return the residual [N, H] of each road by a ridge regression on all others."""
    predicted = np.zeros_like(residual)
    for road in np.unique(roads):
        others = roads != road
        predicted[~others] = ridge(cue[others], residual[others], penalty, cue[~others])
    return predicted


def ridge(
    cue: FloatArray,  # [N, C]
    residual: FloatArray,  # [N, H]
    penalty: float,
    unseen: FloatArray,  # [M, C]
) -> FloatArray:
    """Return the residuals [M, H] of unseen windows; residuals above three deviations are cut."""
    scale = np.sqrt((cue**2).mean(axis=0)) + 1e-9
    limit = 3 * np.sqrt((residual**2).mean(axis=0))
    target = np.clip(residual, -limit, limit)
    inputs, new_inputs = (np.clip(values / scale, -3, 3) for values in (cue, unseen))
    normal_matrix = inputs.T @ inputs + penalty * len(inputs) * np.eye(inputs.shape[1])
    return np.asarray(new_inputs @ np.linalg.solve(normal_matrix, inputs.T @ target))
