"""The live predictor: like the batch pipeline, frame by frame, and never wrong without a warning."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import street

from geovp_classic import registry
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.forecasting.constant import Hold
from geovp_classic.forecasting.selected import Selected
from geovp_classic.geometry import se3
from geovp_classic.predictors.hindcast import HindcastVerdict
from geovp_classic.streaming import Command, LivePredictor, LiveSettings, LiveView
from geovp_classic.streaming.present import Present
from geovp_classic.types import ByteArray, Clip, FloatArray, Trajectory

NUM_PAST = 10


@pytest.fixture(scope="module")
def clip() -> Clip:
    return street.clip(num_frames=24)


@pytest.fixture
def live(clip: Clip) -> LivePredictor:
    """Return a predictor that has seen the first ten frames."""
    return streamed(clip)


def streamed(clip: Clip, num_frames: int = NUM_PAST) -> LivePredictor:
    live = LivePredictor(clip.intrinsics, clip.camera_height_m)
    for frame, time_s in zip(clip.frames[:num_frames], clip.times_s, strict=False):
        assert live.push(frame, time_s).status == "used"
    return live


def psnr_db(frame: ByteArray, other: ByteArray) -> float:
    return float(-10 * np.log10(max(np.mean((frame / 255.0 - other / 255.0) ** 2), 1e-9)))


def batch_psnr_db(clip: Clip) -> FloatArray:
    predictor = registry.build(
        "predictors", {"name": "geometric", "pose_source": "chained", "renderer": "depth-fusion"}
    )
    context, target = clip.split(NUM_PAST, predictor.needs)
    frames = predictor.predict(context).frames[0]
    return np.array([psnr_db(*pair) for pair in zip(frames, target.frames, strict=True)])


def live_psnr_db(clip: Clip) -> FloatArray:
    live = streamed(clip)
    views = [live.view(time_s) for time_s in clip.times_s[NUM_PAST:]]
    frames = clip.frames[NUM_PAST:]
    return np.array(
        [
            psnr_db(view.frame, frame) if view.is_predicted else np.nan
            for view, frame in zip(views, frames, strict=True)
        ]
    )


def test_views_are_as_good_as_those_of_the_batch_pipeline(clip: Clip) -> None:
    live = live_psnr_db(clip)
    assert np.isfinite(live).all()
    assert live.mean() > batch_psnr_db(clip).mean() - 0.1


def kitti_clips() -> Iterator[Clip]:
    if "GEOVP_TEST_DATA" not in os.environ:
        pytest.skip("GEOVP_TEST_DATA is not set: needs KITTI odometry")
    root = Path(os.environ["GEOVP_TEST_DATA"]) / "kitti"
    dataset = registry.build(
        "datasets",
        {"name": "kitti", "root": str(root), "split": "val", "num_frames": 30}
        | {"size_px": [256, 256], "stride": 75},
    )
    for index in range(len(dataset)):
        yield dataset[index]


def test_real_views_are_as_good_as_those_of_the_batch_pipeline() -> None:
    differences = [np.nanmean(live_psnr_db(clip) - batch_psnr_db(clip)) for clip in kitti_clips()]
    assert len(differences) >= 4
    assert abs(np.mean(differences)) < 0.1


def test_memory_is_bounded() -> None:
    clip = street.clip(num_frames=48, step_m=0.3)
    live = LivePredictor(clip.intrinsics, clip.camera_height_m)
    sizes = []
    for frame, time_s in zip(clip.frames, clip.times_s, strict=True):
        live.push(frame, time_s)
        sizes.append(len(pickle.dumps(live.__dict__)))
    assert max(sizes[34:]) < 1.1 * max(sizes[20:34])


def test_a_frame_that_is_not_newer_is_late(live: LivePredictor, clip: Clip) -> None:
    before = live.view(clip.times_s[NUM_PAST])
    assert live.push(clip.frames[8], clip.times_s[8]).status == "late"
    assert (live.view(clip.times_s[NUM_PAST]).frame == before.frame).all()


def test_a_repeated_frame_is_no_standstill(live: LivePredictor, clip: Clip) -> None:
    assert live.push(clip.frames[9], clip.times_s[10]).status == "duplicate"
    view = live.view(clip.times_s[11])
    assert view.is_predicted
    assert psnr_db(view.frame, clip.frames[11]) > psnr_db(clip.frames[9], clip.frames[11]) + 3


def test_in_a_tunnel_the_black_frame_is_shown_with_a_warning(
    live: LivePredictor, clip: Clip
) -> None:
    black = np.zeros_like(clip.frames[0])
    assert live.push(black, clip.times_s[10]).status == "blank"
    view = live.view(clip.times_s[11])
    assert view.warning == "the newest frame is blank"
    assert (view.frame == 0).all()
    assert view.confidence == 0
    assert live.push(clip.frames[11], clip.times_s[11]).status == "used"
    assert live.view(clip.times_s[12]).is_predicted


def test_blank_frames_are_recognised_between_bars(clip: Clip) -> None:
    boxed = clip.frames[:4].copy()
    boxed[[1, 3]] = 90
    boxed[:, :10] = boxed[:, -10:] = 0
    live = LivePredictor(clip.intrinsics)
    statuses = [live.push(*pair).status for pair in zip(boxed, clip.times_s, strict=False)]
    assert statuses == ["used", "blank", "used", "blank"]


def test_an_old_frame_is_shown_with_a_warning(live: LivePredictor, clip: Clip) -> None:
    view = live.view(clip.times_s[9] + 3.1)
    assert view.warning == "the last usable frame is 3.1 s old"
    assert (view.frame == clip.frames[9]).all()
    assert view.age_s == pytest.approx(3.1)
    assert "use one clock" in live.view(clip.times_s[9] - 3.0).warning


def test_after_a_cut_the_track_starts_anew(live: LivePredictor, clip: Clip) -> None:
    upside_down = clip.frames[:, ::-1, ::-1]
    statuses = [live.push(upside_down[step], clip.times_s[10 + step]).status for step in range(6)]
    assert "restarted" in statuses[:4]
    live.reset()
    with pytest.raises(Incompatible, match="push one before"):
        live.view(30.0)


@dataclass(frozen=True)
class Watching(Hold):
    """A forecaster that calls a function, which is done in the middle of a push."""

    calls: list[Callable[[], None]] = field(default_factory=list)

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        for call in self.calls:
            call()
        return super().forecast(past, times_s, num_samples)


@pytest.mark.parametrize("jump_s", [-3600.0, 3600.0])
def test_during_a_push_after_a_gap_the_new_frame_is_shown(clip: Clip, jump_s: float) -> None:
    watching = Watching()
    settings = LiveSettings(forecaster=watching)
    live = LivePredictor(clip.intrinsics, clip.camera_height_m, settings)
    for step in range(5):
        live.push(clip.frames[step], clip.times_s[step])
    time_s = clip.times_s[5] + jump_s
    seen: list[LiveView] = []
    watching.calls.append(lambda: seen.append(live.view(time_s + 0.1)))
    assert live.push(clip.frames[5], time_s).status == "restarted"
    assert [view.warning for view in seen] == ["too few usable frames since the start: 0"]
    assert (seen[0].frame == clip.frames[5]).all()


def shift_px(view: LiveView, reference: LiveView) -> float:
    """Return how far the content of a view lies to the right of that of another."""
    grey, other = view.frame.mean(axis=(0, 2)), reference.frame.mean(axis=(0, 2))
    shifts = np.arange(-20, 21)
    errors = [np.abs(np.roll(other, shift)[20:-20] - grey[20:-20]).mean() for shift in shifts]
    return float(shifts[np.argmin(errors)])


def test_a_forecaster_is_chosen_with_each_tested_prediction(
    clip: Clip, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In each of nine frames until ten are remembered, and then in one of five."""
    select = Mock(side_effect=Selected.select)
    monkeypatch.setattr(Selected, "select", lambda *given: select(*given))
    streamed(clip, num_frames=20)
    assert select.call_count == 9 + 2


def test_commands_replace_the_forecast(live: LivePredictor, clip: Clip) -> None:
    last_s = clip.times_s[9]
    stop = live.view(last_s + 0.5, [Command(last_s, 0.0, 0.0)])
    assert psnr_db(stop.frame, clip.frames[9]) > 30
    right = live.view(last_s + 0.5, [Command(last_s, 0.0, 0.1)])
    assert shift_px(right, stop) == pytest.approx(-0.05 * clip.intrinsics.fx_px, abs=2)
    end_px = right.path_px[-1]  # turned on the spot: the path stays below the camera
    assert np.isnan(end_px).all() or end_px[1] > clip.intrinsics.height_px


def test_commands_are_along_the_plane_of_a_camera_that_looks_aside(clip: Clip) -> None:
    poses = se3.exp(np.outer(np.arange(10), [1, 0.02, 0.01, 0, 0, 0]))
    past = Trajectory(poses, clip.times_s[:10], is_metric=True)
    scene = Mock(verdict=HindcastVerdict(shown_by="image-motion"))
    settings = LiveSettings(path_s=0.0)
    present = Present(settings, scene, past, np.ones(10, bool), past.times_s, poses[None])
    last_s = past.times_s[-1]
    path, _ = present.path(last_s + 1, [Command(last_s, 10.0, 0.0)], None)
    np.testing.assert_allclose(path[:, :3, 3] - poses[-1, :3, 3], [[0, 0, 10]], atol=1)
    assert present.caution(0.0, 1.0, is_given=True) is None
    assert present.caution(1.5, 1.0, is_given=True) == "the newest image is 1.5 s old"
    assert present.caution(0.0, 0.3, is_given=True) == "the confidence is 30 %"
    assert "motion of the image" in present.caution(0.0, 1.0, is_given=False)


def test_the_path_lies_on_the_road_ahead(live: LivePredictor, clip: Clip) -> None:
    view = live.view(clip.times_s[10], [Command(clip.times_s[9], 8.0, 0.0)])
    camera = clip.intrinsics
    horizon = view.path_px[-1]  # sixteen metres ahead, seen from 1.65 m
    assert horizon[0] == pytest.approx(camera.cx_px, abs=8)
    assert horizon[1] == pytest.approx(
        camera.cy_px + camera.fy_px * street.CAMERA_HEIGHT_M / 15.2, abs=8
    )
    left, right = view.path_sides_px[:, -1]
    assert right[0] - left[0] == pytest.approx(camera.fx_px * 1.8 / 15.2, rel=0.1)


def test_without_its_height_a_camera_has_no_path_and_no_commands(clip: Clip) -> None:
    live = streamed(replace(clip, camera_height_m=None))
    view = live.view(clip.times_s[12])
    assert view.is_predicted
    assert len(view.path_px) == 0
    with pytest.raises(Incompatible, match="give the camera"):
        live.view(clip.times_s[12], [Command(0.0, 1.0, 0.0)])


def test_bad_input_is_explained(live: LivePredictor, clip: Clip) -> None:
    camera, frame, time_s, nan = clip.intrinsics, clip.frames[0], clip.times_s[10], np.nan
    for message, wrong in {
        "resize it": lambda: live.push(frame[::2], 30.0),
        "expected seconds": lambda: live.push(frame, nan),
        "time of the frame is None, expected seconds": lambda: live.push(frame, None),
        "expected LiveSettings": lambda: LivePredictor(camera, settings={"num_frames": 5}),
        "camera_height_m is '1.4', expected a number": lambda: LivePredictor(camera, "1.4"),
        "camera_height_m is -1": lambda: LivePredictor(camera, -1),
        "num_frames is 5, expected more than 5": lambda: LiveSettings(num_frames=5),
        "sort them": lambda: live.view(time_s, [Command(2.0, 1.0, 0.0), Command(1.0, 1.0, 0.0)]),
        "must be finite": lambda: Command(0.0, nan, 0.0),
        "time of the view is nan": lambda: live.view(nan),
        "last_from_present: pose": lambda: live.view(time_s, (), 2 * np.eye(4)),
    }.items():
        with pytest.raises(BadData, match=message):
            wrong()


def test_drawing_into_a_late_image_does_not_change_the_predictor(clip: Clip) -> None:
    live = LivePredictor(clip.intrinsics)
    live.push(clip.frames[0], 0.0)
    with pytest.raises(ValueError, match="read-only"):
        live.view(0.0).frame[:] = 0
    np.testing.assert_array_equal(live.view(0.0).frame, clip.frames[0])
