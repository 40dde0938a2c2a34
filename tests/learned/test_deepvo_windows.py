"""What DeepVO learns from: images and motions that still belong together after every augmentation."""

from dataclasses import replace

import numpy as np
import street
import torch
from torch.utils.data import default_collate

from geovp_classic.geometry import planar, se3
from geovp_classic.types import FloatArray
from geovp_learned import stored_clips
from geovp_learned.deepvo import windows
from geovp_learned.deepvo.network import Architecture
from geovp_learned.deepvo.train import DeepVoTraining
from geovp_learned.deepvo.windows import NO_AUGMENTATION, Augmentation
from geovp_learned.methods import Batch
from geovp_learned.stored_clips import Window

CAMERA = Architecture(size_px=(64, 64), focal_widths=1.5).camera
DRIVE = windows.prepare(street.clip(), CAMERA)
REAL = se3.inverse(DRIVE["world_from_cam"][:-1]) @ DRIVE["world_from_cam"][1:]


def parts(batch: Batch) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Images [P, H, W, 3], motions and the mask of those that are known."""
    images = batch["images"].movedim(1, -1).numpy()
    return images, batch["motions"].double().numpy(), batch["is_known"].numpy()


def drawn(
    augmentation: Augmentation, seed: int = 0, first: int = 0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    return parts(windows.sample(Window(DRIVE, first), CAMERA, 4, 3, augmentation, rng))


def yaw_deg(motion: FloatArray) -> FloatArray:
    return np.rad2deg(planar.reduce(motion, np.eye(4), np.eye(4))[..., 2])


def test_the_wide_image_is_read_where_there_is_one() -> None:
    assert DRIVE["frames"][0].shape == (
        82,
        123,
        3,
    )  # 128 x 192, at 96 instead of 150 pixels of focal length
    assert windows.prepare(replace(street.clip(), full=None), CAMERA)["frames"][0].shape == (
        82,
        82,
        3,
    )


def test_mirroring_turns_right_into_left() -> None:
    (plain, motions, _), (mirrored, exchanged, _) = (
        drawn(NO_AUGMENTATION),
        drawn(replace(NO_AUGMENTATION, mirror_probability=1.0)),
    )
    np.testing.assert_allclose(yaw_deg(exchanged), -yaw_deg(motions), atol=1e-4)
    assert yaw_deg(motions).min() > 0.5  # this street bends to the right
    flipped = plain[
        :, :, ::-1
    ]  # the principal point at 29.5 of 63 pixels: 4.1 pixels off its mirror image
    moved = abs(mirrored[:, :, 4:-8].astype(int) - flipped[:, :, 8:-4]).mean()
    assert moved < abs(mirrored[:, :, 4:-8].astype(int) - flipped[:, :, 4:-8]).mean() / 4


def test_every_other_frame_is_twice_the_motion() -> None:
    _, motions, known = drawn(replace(NO_AUGMENTATION, fast_probability=1.0))
    np.testing.assert_allclose(motions[0], REAL[0] @ REAL[1], atol=1e-4)
    np.testing.assert_array_equal(
        known, [True] * 4 + [False] * 2
    )  # of 10 frames: 2, 4, 6, 8, but not 10 and 12


def test_a_swing_adds_its_rate_to_the_past_and_leaves_the_future_out() -> None:
    swing = replace(NO_AUGMENTATION, turn_probability=1.0, turn_deg=3.0)
    _, motions, known = drawn(swing, seed=1)
    added = yaw_deg(motions) - yaw_deg(REAL[:6])
    np.testing.assert_allclose(added, added[0], atol=1e-4)
    assert 0.1 < abs(added[0]) <= 3.0
    np.testing.assert_array_equal(known, [True] * 3 + [False] * 3)


def test_a_swung_image_is_what_a_turned_camera_sees() -> None:
    """Half way through the window the swing is nil: of 3 images the last is turned one way, the
    first the other.
    """
    rng = np.random.default_rng(5)
    swing = replace(NO_AUGMENTATION, turn_probability=1.0, turn_deg=3.0)
    images, motions, _ = parts(windows.sample(Window(DRIVE, 0), CAMERA, 3, 1, swing, rng))
    rng = np.random.default_rng(5)
    plain, _, _ = parts(windows.sample(Window(DRIVE, 0), CAMERA, 3, 1, NO_AUGMENTATION, rng))
    np.testing.assert_array_equal(images[1], plain[1])
    rate_px = np.deg2rad(yaw_deg(motions)[0] - yaw_deg(REAL)[0]) * CAMERA.fx_px
    shift_px = round(rate_px)  # turning right moves the image to the left
    assert abs(shift_px) >= 1
    middle = slice(16, 48)
    moved = np.roll(plain[2], -shift_px, axis=1)[middle, middle].astype(int)
    still = plain[2][middle, middle].astype(int)
    assert (
        abs(images[2][middle, middle] - moved).mean()
        < abs(images[2][middle, middle] - still).mean()
    )


def test_grey_has_three_equal_channels_and_gamma_is_the_same_for_all_frames() -> None:
    grey, _, _ = drawn(replace(NO_AUGMENTATION, grey_probability=1.0))
    np.testing.assert_array_equal(grey[..., 0], grey[..., 2])
    (plain, _, _), (dark, _, _) = drawn(NO_AUGMENTATION), drawn(replace(NO_AUGMENTATION, gamma=1.0))
    for level in (60, 180):
        assert len(np.unique(dark[plain == level])) == 1


def test_windows_are_every_run_that_fits() -> None:
    assert [window.first for window in stored_clips.windows([DRIVE], 7, 1)] == [0, 1, 2, 3]
    assert [window.first for window in stored_clips.windows([DRIVE], 7, stride=2)] == [0, 2]
    assert stored_clips.windows([DRIVE], 11, 1) == []


def test_a_batch_draws_how_much_past_is_seen() -> None:
    method = DeepVoTraining(
        Architecture(size_px=(64, 64)), num_past=4, num_future=3, shortest_past=2
    )
    examples = method.examples([method.prepare(street.clip())], training=True)
    rng = np.random.default_rng(0)
    batch = default_collate([method.example(each, rng) for each in examples[:2]])
    assert batch["motions"].shape == (2, 6, 4, 4)
    assert batch["is_known"].shape == (2, 6)
    seen: set[int] = set()

    def network(images: torch.Tensor, num_future: int) -> tuple[torch.Tensor, torch.Tensor]:
        seen.add(images.shape[1])
        return torch.zeros(2, images.shape[1] - 1, 3), torch.zeros(2, num_future, 3)

    for _ in range(20):
        method.training_step({"poses": network}, batch, 0)
    assert seen == {2, 3, 4}
