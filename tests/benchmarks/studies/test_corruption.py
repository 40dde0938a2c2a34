"""What is done to clips, and what is left of a method then."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from geovp_benchmarks.cli import main
from geovp_classic import registry
from geovp_classic.types import Clip, PrivilegedInput
from studies import command_line
from studies.corruption import NUM_PAST, corrupted, gains_db
from studies.corruption.figure import corruption_figure
from studies.corruption.kinds import CORRUPTIONS, NUM_SEVERITIES
from tests.benchmarks.conftest import write_kitti

EVERYTHING = PrivilegedInput.PAST_POSES | PrivilegedInput.FUTURE_POSES

METHODS = {
    "true crop": (
        registry.build("pose_sources", {"name": "ground-truth"}),
        registry.build("renderers", "depth-fusion"),
    )
}


@pytest.fixture(scope="module")
def clip() -> Clip:
    data = registry.build(
        "datasets", {"name": "synthetic", "num_clips": 1, "num_frames": 30, "size_px": [64, 64]}
    )
    found: Clip = data[0]
    return found


def test_what_passes_leaves_the_future_alone_and_what_lasts_does_not(clip: Clip) -> None:
    black, _ = corrupted(clip, CORRUPTIONS["black frames"], 0, EVERYTHING)
    assert np.flatnonzero((black.frames == 0).all(axis=(1, 2, 3))).tolist() == [5]
    for name, lasts in (
        ("black frames", False),
        ("swapped frames", False),
        ("dim", True),
        ("hood", True),
    ):
        _, target = corrupted(clip, CORRUPTIONS[name], 1, EVERYTHING)
        assert (target.frames == clip.frames[NUM_PAST:]).all() != lasts


def test_a_standing_camera_stands_in_its_poses_too(clip: Clip) -> None:
    context, target = corrupted(clip, CORRUPTIONS["stationary"], 0, EVERYTHING)
    assert (target.frames == context.frames[-1]).all()
    assert context.future is not None
    assert (context.future.world_from_cam == context.future.world_from_cam[0]).all()
    assert gains_db(clip, "stationary", 0, METHODS) == [0]


def test_a_black_frame_costs_fusion_little(clip: Clip) -> None:
    black, clean = (gains_db(clip, name, 0, METHODS) for name in ("black frames", "none"))
    assert black > clean - 0.5


def test_curves_have_a_panel_a_corruption_and_a_line_a_method() -> None:
    methods = [("true", "crop"), ("vo", "crop")]
    gains = {
        "none": np.array([[9.0, 6.0]]),
        "hood": np.array([[8.0, 5.0], [7.0, 4.0], [6.0, np.nan], [5.0, 2.0]]),
    }
    figure = corruption_figure(gains, methods, 0.5)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert [axes.get_title() for axes in shown] == ["none", "hood"]
    clean, hood = (axes.get_lines()[1:] for axes in shown)
    assert [line.get_label() for line in hood] == ["true crop", "vo crop"]
    np.testing.assert_array_equal(np.asarray(clean[1].get_ydata()), [6.0] * 4)
    np.testing.assert_array_equal(np.asarray(hood[1].get_ydata()), [5.0, 4.0, np.nan, 2.0])


def test_the_command_draws_curves_and_writes_its_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, picture = tmp_path / "page.md", tmp_path / "curves.png"
    page.write_text("# Old\n\n## Notes\n\nkept\n")
    spec = {"name": "synthetic", "num_clips": 1, "num_frames": 30, "size_px": [64, 64]}
    write_kitti(tmp_path / "kitti", "03", registry.build("datasets", spec)[0])
    given = ["corruption", str(tmp_path / "kitti"), "03", "--only", "stationary"]
    assert main([*given, "--plot", str(picture), "--page", str(page)], command_line()) == 0
    assert "stationary 1" in capsys.readouterr().out
    assert cv2.imread(str(picture)).shape[1] > 1000
    text = page.read_text()
    assert "python benchmarks/studies corruption path/to/kitti '03' --stride 60" in text
    assert "| stationary 1 " in text
    assert text.endswith("## Notes\n\nkept\n")


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_all_severities_of_a_corruption_change_the_clip(clip: Clip, name: str) -> None:
    for level in range(NUM_SEVERITIES):
        context, target = corrupted(clip, CORRUPTIONS[name], level, EVERYTHING)
        assert context.num_past == NUM_PAST
        assert target.frames.shape == (20, 64, 64, 3)
        changed = (context.frames != clip.frames[:NUM_PAST]).any()
        changed |= context.intrinsics != clip.intrinsics
        changed |= (context.times_s != clip.times_s).any()
        assert bool(changed) is (name != "none")
