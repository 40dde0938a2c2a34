"""A vehicle that is followed: found by its corners, hidden from pose source and renderer, and shown
where it was.
"""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.geometry import pinhole
from geovp_classic.observation import Observer
from geovp_classic.observation.followed_vehicle import FollowedVehicle, FollowedVehicleDetector
from geovp_classic.odometry.monocular import Monocular
from geovp_classic.pose_sources.ground_truth import GroundTruth
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.rendering.masked_scene import MaskedScene
from geovp_classic.types import BoolArray, ByteArray, Clip, ExtraView, Intrinsics
from tests.geovp_classic.observation.test_scene_mask import Noted

SIDE, PAST = 160, 10
NEAR = np.array([-0.13, -0.12, 0.13, 0.11])  # on the plane z = 1: left, top, right, bottom


@pytest.fixture(scope="module")
def clip() -> Clip:
    """Twelve frames of a street."""
    return Synthetic(seed=3, num_clips=1, num_frames=12, size_px=(SIDE, SIDE), with_full=True)[0]


def outline(camera: Intrinsics, scale: float = 1.0) -> BoolArray:
    """Where a camera [H, W] sees the vehicle's back."""
    row, column = np.indices((camera.height_px, camera.width_px))
    x, y = (column - camera.cx_px) / camera.fx_px, (row - camera.cy_px) / camera.fy_px
    left, top, right, bottom = NEAR * scale
    return np.asarray((x >= left) & (x <= right) & (y >= top) & (y <= bottom))


def around(camera: Intrinsics) -> BoolArray:
    """What may be taken for it [H, W]: pixels near it, and clouds above it, which stay in place as
    well.
    """
    near = outline(camera, 1.4)
    near[: near.any(axis=1).argmax()] = True
    return near


def followed(frames: ByteArray, camera: Intrinsics, growth: float = 0.0) -> ByteArray:
    """The frames [P, H, W, 3] with a spotted vehicle ahead, larger by `growth` in each than in the
    one before.
    """
    spots = 40 + 160 * np.random.default_rng(1).random((14, 16)).astype(np.float32)
    shown = []
    for step, frame in enumerate(frames):
        mask = outline(camera, 1 + growth * step)
        rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
        back = frame.copy()
        size = len(columns), len(rows)
        back[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] = cv2.resize(
            spots, size, interpolation=cv2.INTER_LINEAR
        )[..., None]
        shown.append(back)
    return np.stack(shown)


def followed_vehicle(frames: ByteArray) -> FollowedVehicle | None:
    return FollowedVehicleDetector().detect(np.stack([pinhole.grey8(frame) for frame in frames]))


def outline_found(frames: ByteArray) -> BoolArray:
    found = followed_vehicle(frames)
    assert found is not None
    return found.mask


@pytest.mark.parametrize("rows_cut", [0, 40])
def test_its_outline_is_found(rows_cut: int, clip: Clip) -> None:
    frames, full = clip.frames[:PAST, rows_cut:], clip.intrinsics
    camera = replace(full, cy_px=full.cy_px - rows_cut, height_px=full.height_px - rows_cut)
    found, true = outline_found(followed(frames, camera)), outline(camera)
    assert (found & true).sum() > 0.9 * true.sum()
    assert not found[~around(camera)].any()


def test_it_is_there_only_where_it_stays_near_its_place_and_the_street_does_not(clip: Clip) -> None:
    frames = followed(clip.frames[:PAST], clip.intrinsics)
    assert followed_vehicle(frames) is not None
    assert followed_vehicle(clip.frames[:PAST]) is None
    assert followed_vehicle(np.repeat(frames[:1], PAST, axis=0)) is None  # the camera stands
    assert (
        followed_vehicle(followed(clip.frames[:PAST], clip.intrinsics, growth=0.04)) is None
    )  # it comes near
    assert followed_vehicle(frames[:3]) is None
    assert followed_vehicle(np.full_like(frames, 128)) is None


@pytest.mark.parametrize("growth", [-0.01, 0.0, 0.01])
def test_it_goes_on_growing_or_shrinking(clip: Clip, growth: float) -> None:
    """As it was in the past, and within three pixels of where it will be."""
    frames = followed(np.repeat(clip.frames[:PAST], 2, axis=0), clip.intrinsics, growth)
    frames[:PAST] = followed(clip.frames[:PAST], clip.intrinsics, growth)
    found = followed_vehicle(frames[:PAST])
    assert found is not None
    true = outline(clip.intrinsics, 1 + growth * (PAST - 1)).astype(np.uint8)
    np.testing.assert_array_equal(found.moved(frames[PAST - 1], 0.0), frames[PAST - 1])
    for step in (0, 4, PAST + 5):
        wanted = outline(clip.intrinsics, 1 + growth * step)
        wrong = (found.moved(true, (PAST - 1 - step) / (PAST - 1)) > 0) ^ wanted
        assert wrong.sum() < 3 * 4 * np.sqrt(wanted.sum())


def test_it_is_shown_where_it_was_and_to_no_pose_source_or_renderer(clip: Clip) -> None:
    assert clip.full is not None
    wide = ExtraView(
        followed(clip.full.frames, clip.full.intrinsics),
        clip.full.intrinsics,
        clip.full.view_from_cam,
    )
    context, _ = replace(clip, frames=followed(clip.frames, clip.intrinsics), full=wide).split(
        PAST, Noted.needs
    )
    observed = Observer().observe(context)
    seen = observed.context
    assert seen.full is not None
    for before, after in ((context.frames, seen.frames), (wide.frames[:PAST], seen.full.frames)):
        camera = context.intrinsics if after is seen.frames else seen.full.intrinsics
        inside = outline(camera, 0.9)
        texture = [
            np.abs(cv2.Laplacian(frames[0], cv2.CV_32F))[inside].mean()
            for frames in (before, after)
        ]
        assert texture[1] < texture[0] / 2
        np.testing.assert_array_equal(after[:, ~around(camera)], before[:, ~around(camera)])
    mask = observed.hidden_mask(Noted.needs)
    scene = GeometricPredictor(GroundTruth(), Noted()).reconstruct(observed, context.past)
    assert isinstance(scene, MaskedScene)
    views = scene.view(np.eye(4)[None], context.times_s[PAST - 1 : PAST], context.intrinsics)
    np.testing.assert_array_equal(
        views.frames[0], np.where(mask[..., None], context.frames[PAST - 1], 77)
    )
    np.testing.assert_array_equal(views.covered[0], mask)


def test_odometry_is_not_stopped_by_it(clip: Clip) -> None:
    context, _ = replace(clip, frames=followed(clip.frames, clip.intrinsics)).split(
        PAST, Monocular().needs
    )
    free, _ = clip.split(PAST, Monocular().needs)
    lengths = []
    for one in (free, context, Observer().observe(context).context):
        poses = Monocular().track(one)[0].world_from_cam
        lengths.append(np.linalg.norm(poses[-1, :3, 3] - poses[0, :3, 3]))
    assert abs(lengths[1] / lengths[0] - 1) > 0.5  # taken for a street that stands still
    assert abs(lengths[2] / lengths[0] - 1) < 0.1
