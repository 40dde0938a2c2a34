from dataclasses import replace

import numpy as np
import pytest

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import Clip
from geovp_learned.synsin import pairs
from geovp_learned.synsin.pairs import Example, FramePairs


@pytest.fixture
def scene(clip: Clip) -> FramePairs:
    return pairs.frame_pairs(Example(clip, 3), [1, 4])


def test_a_scene_holds_later_frames_and_the_motion_to_them(scene: FramePairs, clip: Clip) -> None:
    np.testing.assert_array_equal(scene.frames[0], clip.frames[3])
    np.testing.assert_array_equal(scene.frames[1:], clip.frames[[4, 7]])
    poses = clip.trajectory.world_from_cam
    np.testing.assert_allclose(poses[7] @ scene.cam_from_last[1], poses[3], atol=1e-12)
    assert scene.cam_from_last[1, 2, 3] == pytest.approx(
        -2.0, abs=0.05
    )  # four steps of half a metre come nearer


def test_known_depth_comes_as_its_inverse(scene: FramePairs, clip: Clip) -> None:
    sky = np.isinf(clip.depths[3])
    assert (scene.inverse_depth[sky] == 0).all()
    np.testing.assert_allclose(scene.inverse_depth[~sky] * clip.depths[3][~sky], 1, rtol=1e-6)
    without = pairs.frame_pairs(Example(replace(clip, depths=None), 3), [1])
    assert np.isnan(without.inverse_depth).all()


def test_a_mirrored_scene_shows_mirrored_points_in_mirrored_pixels(scene: FramePairs) -> None:
    point = np.array([[1.2, -0.4, 9.0]])
    mirrored = scene.mirrored()
    for number in range(2):
        seen, _ = pinhole.project(
            se3.transform(scene.cam_from_last[number], point), scene.intrinsics
        )
        point_mirrored = point * [-1, 1, 1]
        other, _ = pinhole.project(
            se3.transform(mirrored.cam_from_last[number], point_mirrored), mirrored.intrinsics
        )
        np.testing.assert_allclose(other, [[31 - seen[0, 0], seen[0, 1]]])
    np.testing.assert_array_equal(mirrored.frames[0, :, 0], scene.frames[0, :, -1])
    np.testing.assert_array_equal(mirrored.mirrored().frames, scene.frames)


def test_augmentation_mirrors_half_and_greys_a_share(scene: FramePairs) -> None:
    drawn = [
        pairs.augmented(scene, np.random.default_rng(seed), grey_probability=0.25)
        for seed in range(200)
    ]
    mirrored = sum(
        one.intrinsics != scene.intrinsics or (one.frames[0, 0, 0] != scene.frames[0, 0, 0]).any()
        for one in drawn
    )
    grey = sum(bool((one.frames[0] == one.frames[0, ..., :1]).all()) for one in drawn)
    assert 80 <= mirrored <= 150  # grey ones look changed as well
    assert 30 <= grey <= 70
