"""A square that moves on its own in front of a wall, seen by a camera that moves sideways."""

import cv2
import numpy as np
import pytest

from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.depth.multiview import Multiview
from geovp_classic.layers.ground import GroundFit
from geovp_classic.layers.moving_regions import MovingRegions
from geovp_classic.observation import Observer, observations_of
from geovp_classic.rendering.layered_scene import LayeredScene
from geovp_classic.rendering.source import Source
from geovp_classic.types import (
    ByteArray,
    FloatArray,
    Intrinsics,
    PrivilegedInput,
    Trajectory,
    Views,
)

SIDE = 128
CAMERA = Intrinsics(100.0, 100.0, 63.5, 63.5, SIDE, SIDE)
WALL = np.full((SIDE, SIDE), 0.2, np.float32)  # inverse depth
SQUARE = slice(40, 80), slice(50, 90)  # in the last frame


def texture(seed: int) -> ByteArray:
    noise = np.random.default_rng(seed).normal(0, 1, (SIDE, 2 * SIDE)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return (128 + 50 * smooth / smooth.std()).clip(0, 255).astype(np.uint8)


def drive(num_frames: int = 10) -> Trajectory:
    """The camera moves by .1 to the right per frame of .1 s: the wall by 2 px to the left."""
    world_from_cam = np.tile(np.eye(4), (num_frames, 1, 1))
    world_from_cam[:, 0, 3] = 0.1 * np.arange(num_frames)
    return Trajectory(world_from_cam, 0.1 * np.arange(num_frames), is_metric=False)


def frames(square_px: int) -> ByteArray:
    """Frames [T, H, W] with a square that moves to the right by some pixels per frame."""
    wall, square = texture(0), texture(1)[: SQUARE[0].stop - SQUARE[0].start, :40]
    images = []
    for step in range(10):
        image = wall[:, 2 * step : 2 * step + SIDE].copy()
        left = SQUARE[1].start + square_px * (step - 9)
        image[SQUARE[0], left : left + 40] = square
        images.append(image)
    return np.stack(images)


@pytest.mark.parametrize("square_px", [0, 1])
def test_a_square_that_moves_on_its_own_is_found(square_px: int) -> None:
    (patch,) = MovingRegions().detect(frames(square_px), drive(), CAMERA, WALL)
    truth = np.zeros((SIDE, SIDE), bool)
    truth[SQUARE] = True
    assert (patch.mask & truth).sum() / patch.mask.sum() > 0.95
    assert (patch.mask & truth).sum() / truth.sum() > 0.95
    # .1 per frame keep up with the camera; 1 px at depth 5 is .05: per second, 1 + .5 square_px
    expected = [1 + 0.5 * square_px, 0, 0]
    np.testing.assert_allclose(patch.velocity_per_s, expected, atol=0.03)


def test_the_wall_itself_and_a_camera_that_stays_have_no_patch() -> None:
    assert MovingRegions().detect(frames(-2), drive(), CAMERA, WALL) == []
    still = Trajectory(np.tile(np.eye(4), (10, 1, 1)), drive().times_s, is_metric=False)
    assert MovingRegions().detect(frames(0), still, CAMERA, WALL) == []


def test_nothing_moves_where_the_static_scene_explains_nothing() -> None:
    """With a wrong depth, the wall differs from earlier frames as much as the square does."""
    assert MovingRegions().detect(frames(0), drive(), CAMERA, 4 * WALL) == []


def test_a_square_without_texture_has_no_patch() -> None:
    """It may as well be a shadow or the sky."""
    plain = frames(1)
    for step, image in enumerate(plain):
        left = SQUARE[1].start + step - 9
        image[SQUARE[0], left : left + 40] = 128
    patches = MovingRegions().detect(plain, drive(), CAMERA, WALL)
    assert all(patch.mask[45:75, 55:85].mean() < 0.1 for patch in patches)


class Grey:
    """A static scene of one grey value, without coverage."""

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        shape = (len(world_from_cam), intrinsics.height_px, intrinsics.width_px)
        blank = np.full((*shape, 3), 77, np.uint8)
        return Views(blank, np.zeros(shape, bool), np.zeros(shape, np.float32))


def scene_of(images: ByteArray) -> LayeredScene:
    past = drive()
    patches = MovingRegions().detect(images, past, CAMERA, WALL)
    last = Source(np.repeat(images[-1][..., None], 3, axis=-1), CAMERA, past.world_from_cam[-1])
    return LayeredScene(Grey(), last, float(past.times_s[-1]), patches)


@pytest.mark.parametrize("square_px", [0, 1])
def test_a_patch_is_shown_where_it_moves_to(square_px: int) -> None:
    images = frames(square_px)
    scene = scene_of(images)
    future = drive(20)[14:15]
    views = scene.view(future.world_from_cam, future.times_s, CAMERA)
    # After five frames, the middle of the square has moved by 5 square_px.
    middle = np.s_[50:70, 60 + 5 * square_px : 80 + 5 * square_px]
    shown, expected = views.frames[0][middle][..., 0], images[-1][50:70, 60:80]
    error_px, _ = cv2.phaseCorrelate(np.float32(expected), np.float32(shown))
    assert np.hypot(*error_px) < 1.5
    assert views.covered[0][middle].all()
    np.testing.assert_allclose(views.depths[0][middle], 5, rtol=0.05)
    assert (views.frames[0][:30] == 77).all()
    assert views.moving[0][middle].all()
    assert not views.moving[0][:30].any()


def test_a_car_ahead_shifts_in_the_image_when_the_camera_pitches() -> None:
    """It moves with the camera, but does not turn with it."""
    images = frames(0)
    scene = scene_of(images)
    future = drive(20)[14:15].world_from_cam.copy()
    future[0, :3, :3], _ = cv2.Rodrigues(np.array([0.05, 0, 0]))  # up: 100 px * .05 = 5 px
    views = scene.view(future, drive(20).times_s[14:15], CAMERA)
    shown, expected = views.frames[0][55:75, 60:80, 0], images[-1][50:70, 60:80]
    error_px, _ = cv2.phaseCorrelate(np.float32(expected), np.float32(shown))
    assert np.hypot(*error_px) < 1.5


def test_a_car_ahead_without_parallax_moves_although_the_camera_shakes() -> None:
    """The static scene would explain it by infinite depth, which lies below the ground."""
    world_from_cam, times_s = drive().world_from_cam.copy(), drive().times_s
    images = []
    for step, frame in enumerate(frames(0)):
        pitch, _ = cv2.Rodrigues(np.array([0.01 * np.sin(step), 0, 0]))  # one pixel
        world_from_cam[step, :3, :3] = pitch
        homography = CAMERA.matrix @ pitch.T @ np.linalg.inv(CAMERA.matrix)
        images.append(cv2.warpPerspective(frame, homography, (SIDE, SIDE)))
    past = Trajectory(world_from_cam, times_s, is_metric=True)
    apparent = WALL.copy()
    apparent[SQUARE] = 0.0
    (patch,) = MovingRegions().detect(np.stack(images), past, CAMERA, apparent, WALL)
    truth = np.zeros((SIDE, SIDE), bool)
    truth[SQUARE] = True
    assert (patch.mask & truth).sum() / (patch.mask | truth).sum() > 0.7
    assert MovingRegions().detect(np.stack(images), past, CAMERA, apparent, None) == []


def test_parallel_edges_do_not_show_their_motion() -> None:
    """Stripes along the motion of the camera look alike under any motion along themselves."""
    stripes = frames(0)
    rows = 50 * np.sin(np.arange(40) / 2) + 128
    for image in stripes:
        image[SQUARE] = rows.astype(np.uint8)[:, None]
    apparent = WALL.copy()
    apparent[SQUARE] = 0.0
    assert MovingRegions().detect(stripes, drive(), CAMERA, apparent, WALL) == []


def test_moving_cars_of_the_street_are_found() -> None:
    """With exact poses; oncoming cars look like static ones that are nearer."""
    found, moving, hit = 0, 0, 0
    dataset = Synthetic(num_clips=7)
    for number in (2, 6):
        clip = dataset[number]
        context = Observer().observe(clip.split(10, PrivilegedInput.PAST_POSES)[0]).context
        depth, confidence = Multiview().inverse_depths(context, context.past)
        ground = GroundFit().inverse_depths(depth[-1], confidence[-1])
        greys = observations_of(context, "crop").greys
        patches = MovingRegions().detect(greys, context.past, context.intrinsics, depth[-1], ground)
        mask = np.zeros(depth.shape[1:], bool)
        for patch in patches:
            mask |= patch.mask
        found, moving = found + mask.sum(), moving + clip.moving[9].sum()
        hit += (mask & clip.moving[9]).sum()
    assert hit > 0.9 * found
    assert hit > 0.6 * moving
