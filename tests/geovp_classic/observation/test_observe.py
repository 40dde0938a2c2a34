"""Components use the last usable frames, and both image streams have the observer's resolution."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import geovp
from geovp_classic import registry
from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.geometry import se3
from geovp_classic.observation import Observer, future_greys
from geovp_classic.pose_refinement.registration import Registration
from geovp_classic.types import Context, ExtraView, Motion, PrivilegedInput, Trajectory
from tests.geovp_classic.observation.test_uncropped import NATIVE, noise_context


@pytest.fixture(scope="module")
def street() -> tuple[Context, Trajectory]:
    """Five frames of a street and ten blank ones, and the true past."""
    clip = Synthetic(num_frames=18, num_clips=1, size_px=(64, 64))[0]
    frames = clip.frames.copy()
    frames[5:15] = 90
    context, _ = replace(clip, frames=frames).split(15, PrivilegedInput.CAMERA_HEIGHT)
    return context, clip.trajectory[:15]


@pytest.mark.parametrize(
    "renderer",
    [
        {"name": "depth-fusion", "num_frames": 3},
        {"name": "volume-fusion", "num_frames": 3},
        {"name": "ground-far-plane"},
    ],
    ids=lambda renderer: renderer["name"],
)
def test_blank_frames_change_no_scene(
    street: tuple[Context, Trajectory], renderer: dict[str, Any]
) -> None:
    context, past = street
    renderer = registry.build("renderers", renderer)
    without_blank = context.observed(np.arange(15) < 5)
    views = []
    for observed, trajectory in ((context, past), (without_blank, past[:5])):
        scene = renderer.reconstruct(Observer().observe(observed).context, trajectory)
        views.append(scene.view(past.world_from_cam[6:7], past.times_s[6:7], context.intrinsics))
    assert views[0].covered.any()
    difference = np.abs(views[0].frames[0].astype(int) - views[1].frames[0])
    # Open3D's threads change a few pixels from run to run.
    assert (difference > 1).mean() < 0.01


def test_blank_frames_are_not_registered(street: tuple[Context, Trajectory]) -> None:
    context, past = street
    given = past.world_from_cam.copy()
    given[3] = given[3] @ se3.exp(np.array([0, 0, 0, np.deg2rad(0.5), 0, 0]))
    motion = Motion(replace(past, world_from_cam=given), given[None, -1:], np.ones(15, bool))
    refined = Registration().refine(Observer().observe(context).context, motion)
    assert np.abs(refined.past.world_from_cam[3] - given[3]).max() > 1e-3


def test_a_video_that_ends_in_ten_blank_frames_is_predicted(
    street: tuple[Context, Trajectory],
) -> None:
    prediction = geovp.predict(street[0])
    assert prediction.frames.std(axis=(0, 2, 3, 4)).min() > 10  # not blank


def test_future_images_have_the_resolution_of_the_observed_ones() -> None:
    context = noise_context(40)  # a square of 40 pixels for the native 80
    future = ExtraView(context.full.frames[:1], NATIVE, np.eye(4))
    context = replace(context, future_full=future)
    observed = Observer(max_full_scale=1.0).observe(context).context
    assert observed.full_observations.greys.shape[1] == 40
    greys = future_greys(observed, "full")
    np.testing.assert_array_equal(greys, observed.full_observations.greys[:1])
