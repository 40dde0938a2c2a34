"""What depth from the last frames adds to the motion prior: cues of the scene against the residual
of its forecast.
"""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geovp_benchmarks.analysis.intervals import sequence_of
from geovp_benchmarks.progress import Progress, tracked
from geovp_classic import registry
from geovp_classic.depth.multiview import Multiview
from geovp_classic.errors import Incompatible
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.geometry import pinhole
from geovp_classic.geometry.ground_plane import GroundFit, GroundPlane
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.types import Clip, FloatArray, Intrinsics, PrivilegedInput
from studies.foreseeable.windows import COMPONENTS, HORIZONS, deviations, states

NUM_PAST = 10
SCAN_DEG, SCAN_BINS = 14.0, 12  # azimuth to either side
SCAN_BANDS_DEG = ((-2.0, 2.0), (1.0, 5.0))  # of elevation
ARCS = np.radians(np.linspace(-25.0, 25.0, 21))  # more yaw than forecast at the last horizon
CLEARANCE_M, OBSTACLES_M = 1.5, (0.4, 2.5)  # beside an arc; over the road
FARTHEST_M = 60.0
LIKELY_RAD, PENALTY = (
    np.radians(4.0),
    0.3,
)  # of the arcs: their spread as such, and what an obstacle weighs
PROFILE_M = np.array([6.0, 8.0, 10.0, 13.0, 16.0, 20.0, 26.0, 34.0])
HALF_WIDTH_M, MOST_HEIGHT_M, LEAST_PIXELS = 2.5, 0.6, 15  # of the profile
BLOCK = 50  # frames that are held out together; those beside them are left out
RIDGE = 0.2  # per window
WINSORISED = 0.98  # quantile at which residuals are cut


@dataclass(frozen=True)
class Scene:
    """One last observed frame, with where the prior says that the camera goes."""

    inverse_depth: FloatArray  # [H, W] per metre
    camera: Intrinsics
    ground: GroundPlane
    path: FloatArray  # [F + 1, 3] positions in the last camera
    travel: FloatArray  # [3], mean direction of the past motion in the last camera
    speed_m_s: float


def scan(scene: Scene) -> FloatArray:
    """Inverse depth by azimuth times speed, right less left: [2 * SCAN_BINS / 2]."""
    rays = pinhole.rays(scene.camera)
    azimuth, elevation = (
        np.degrees(np.arctan2(one, rays[..., 2])) for one in (rays[..., 0], -rays[..., 1])
    )
    edges = np.linspace(-SCAN_DEG, SCAN_DEG, SCAN_BINS + 1)
    found = []
    for low, high in SCAN_BANDS_DEG:
        band = (elevation >= low) & (elevation < high)
        bins = [band & (azimuth >= a) & (azimuth < b) for a, b in itertools.pairwise(edges)]
        medians = np.array(
            [np.median(scene.inverse_depth[one]) if one.any() else 0.0 for one in bins]
        )
        found.append((medians[::-1] - medians)[: SCAN_BINS // 2] * scene.speed_m_s)
    return np.concatenate(found)


def clearance(scene: Scene) -> FloatArray:
    """Expected yaw [1] beyond the forecast's at its end, if arcs near obstacles are less likely."""
    path, points = scene.path[1:], obstacles(scene)
    run = np.cumsum(np.linalg.norm(np.diff(scene.path, axis=0), axis=1))
    if not len(points) or run[-1] < 1.0:
        return np.zeros(1)
    log_weights = []
    for yaw in ARCS:
        x = path[:, 0] + yaw * run**2 / (2 * run[-1])
        distance = np.hypot(points[:, :1] - x, points[:, 2:] - path[:, 2]).min(axis=1)
        seen = (
            np.maximum(1 - distance / CLEARANCE_M, 0)
            @ (points[:, 2] / 10) ** 2
            / scene.inverse_depth.size
        )
        log_weights.append(-abs(yaw) / LIKELY_RAD - PENALTY * 400 * seen)
    weights = np.exp(log_weights - np.max(log_weights))
    return np.array([weights @ ARCS / weights.sum()])


def obstacles(scene: Scene) -> FloatArray:
    """Points [N, 3] that stand on the road's plane and a car would hit, of every second pixel and
    row.
    """
    near = scene.inverse_depth[::2, ::2]
    seen = near > 1 / FARTHEST_M
    points = pinhole.rays(scene.camera)[::2, ::2][seen] / near[seen][:, None]
    height = scene.ground.height - points @ scene.ground.normal
    return points[(height > OBSTACLES_M[0]) & (height < OBSTACLES_M[1])]


def plane_pitch(scene: Scene) -> FloatArray:
    """How far the road ahead rises over the direction of travel [1], radians."""
    return np.array([np.arcsin(np.clip(scene.ground.normal @ scene.travel, -1, 1))])


def plane_roll(scene: Scene) -> FloatArray:
    """The camera's clockwise roll over the road ahead [1], radians."""
    return np.array([np.arctan2(scene.ground.normal[0], scene.ground.normal[1])])


def profile(scene: Scene) -> FloatArray:
    """Height of the road along the forecast path over its plane [7], metres; 0 where it is not
    seen.
    """
    rays = pinhole.rays(scene.camera)
    depth = 1 / np.maximum(scene.inverse_depth, 1e-3)
    height = scene.ground.height - rays @ scene.ground.normal * depth
    road = (
        np.abs(rays[..., 0] * depth - np.interp(depth, scene.path[:, 2], scene.path[:, 0]))
        < HALF_WIDTH_M
    )
    road &= np.abs(height) < MOST_HEIGHT_M
    parts = [road & (depth >= a) & (depth < b) for a, b in itertools.pairwise(PROFILE_M)]
    return np.array([np.median(height[one]) if one.sum() > LEAST_PIXELS else 0.0 for one in parts])


@dataclass(frozen=True)
class Cue:
    """A measure of the scene, and the component that it may tell of."""

    measure: Callable[[Scene], FloatArray]
    component: str
    is_centred: bool  # less its median over the sequence: how the camera is mounted is not a cue


CUES: Mapping[str, Cue] = {
    "inverse-depth scan": Cue(scan, "yaw", is_centred=False),
    "clearance of arcs": Cue(clearance, "yaw", is_centred=False),
    "pitch of the road's plane": Cue(plane_pitch, "pitch", is_centred=True),
    "height profile of the road": Cue(profile, "pitch", is_centred=True),
    "roll of the road's plane": Cue(plane_roll, "roll", is_centred=True),
}


@dataclass(frozen=True)
class CueWindows:
    """N windows of images."""

    cues: Mapping[str, FloatArray]  # [N, C] each
    residuals: FloatArray  # [N, H, 6], of the motion prior
    sequences: npt.NDArray[np.str_]  # [N]
    starts: npt.NDArray[np.intp]  # [N], number of the first frame


@single_threaded_blas
def read(root: Path, sizes_px: Mapping[str, int], stride: int, progress: Progress) -> CueWindows:
    """Windows of stretches of KITTI, each with the size of its square crop; without a ground they
    are left out.
    """
    rows: list[tuple[dict[str, FloatArray], FloatArray, str, int]] = []
    for stretch, size_px in sizes_px.items():
        spec = {
            "name": "kitti",
            "root": str(root),
            "sequences": [stretch],
            "size_px": [size_px, size_px],
        }
        dataset = registry.build(
            "datasets", {**spec, "num_frames": NUM_PAST + int(HORIZONS[-1]), "stride": stride}
        )
        for number in tracked(range(len(dataset)), len(dataset), progress):
            clip = dataset[number]
            found = _scene(clip)
            if found is not None:
                cues = {name: cue.measure(found[0]) for name, cue in CUES.items()}
                rows.append(
                    (cues, found[1], sequence_of(clip.name), int(clip.name.rpartition("/")[2]))
                )
    if not rows:
        raise Incompatible(
            f"{root}: no window of {', '.join(sizes_px)} shows a road: give other --frames"
        )
    table, residuals, sequences, starts = zip(*rows, strict=True)
    by_cue = {name: np.stack([row[name] for row in table]) for name in CUES}
    return CueWindows(by_cue, np.stack(residuals), np.array(sequences), np.array(starts))


def _scene(clip: Clip) -> tuple[Scene, FloatArray] | None:
    """The scene and the prior's residuals [H, 6]; None where no ground can be fitted."""
    if clip.trajectory is None:
        raise Incompatible(
            f"{clip.name} has no recorded poses to forecast from: give sequences with poses"
        )
    context, _ = clip.split(NUM_PAST, PrivilegedInput.PAST_POSES)
    past, ahead = clip.trajectory[:NUM_PAST], NUM_PAST - 1 + HORIZONS
    inverse_depth = Multiview().inverse_depths(context, past)[0][-1]
    ground = GroundFit().fit(inverse_depth, clip.intrinsics)
    if ground is None:
        return None
    forecast = MotionPrior().forecast(past, clip.times_s[NUM_PAST:])[0]
    last_from_world = np.linalg.inv(past.world_from_cam[-1])
    path = (last_from_world @ np.concatenate([past.world_from_cam[-1:], forecast]))[:, :3, 3]
    moved = -(last_from_world @ past.world_from_cam[0])[:3, 3]
    length, duration_s = float(np.linalg.norm(moved)), float(past.times_s[-1] - past.times_s[0])
    scene = Scene(
        inverse_depth, clip.intrinsics, ground, path, moved / max(length, 1e-6), length / duration_s
    )
    base = states(forecast, past)[HORIZONS - 1]
    off = [
        deviations(poses, past, base)
        for poses in (clip.trajectory.world_from_cam[ahead], forecast[HORIZONS - 1])
    ]
    return scene, off[0] - off[1]


def held_out(windows: CueWindows, name: str) -> tuple[FloatArray, FloatArray]:
    """A cue's component of the residuals, winsorised, and what the cue says of it, both [N, H].

    A ridge regression without intercept, fitted without the block asked for and its neighbours in
    the sequence.
    """
    cue, values = CUES[name], windows.cues[name].copy()
    truth = windows.residuals[..., COMPONENTS.index(cue.component)]
    limit = np.quantile(np.abs(truth), WINSORISED, axis=0)
    truth = np.clip(truth, -limit, limit)
    if cue.is_centred:
        for sequence in np.unique(windows.sequences):
            own = windows.sequences == sequence
            values[own] -= np.median(values[own], axis=0)
    blocks, said = windows.starts // BLOCK, np.zeros_like(truth)
    for sequence, block in sorted({*zip(windows.sequences.tolist(), blocks.tolist(), strict=True)}):
        asked = (windows.sequences == sequence) & (blocks == block)
        known = ~((windows.sequences == sequence) & (np.abs(blocks - block) <= 1))
        if known.any():
            scale = np.sqrt((values[known] ** 2).mean(axis=0)) + 1e-9
            inputs, new = (np.clip(values[which] / scale, -3, 3) for which in (known, asked))
            matrix = inputs.T @ inputs + RIDGE * len(inputs) * np.eye(inputs.shape[1])
            said[asked] = new @ np.linalg.solve(matrix, inputs.T @ truth[known])
    return truth, said


def correlations(windows: CueWindows, name: str) -> dict[str, float]:
    """Correlation by sequence of a cue of one number with its residual at the last horizon; none
    for several.
    """
    values, truth = windows.cues[name], held_out(windows, name)[0][:, -1]
    if values.shape[1] > 1:
        return {}
    owns = {str(one): windows.sequences == one for one in np.unique(windows.sequences)}
    return {
        one: float(np.corrcoef(values[own, 0], truth[own])[0, 1])
        for one, own in owns.items()
        if own.sum() > 2 and np.ptp(values[own]) > 0
    }
