"""Image cues: mirrored images, a known road with an obstacle, and regressions on other roads."""

from pathlib import Path

import numpy as np
import pytest

from geovp_classic.data.synthetic import Synthetic
from geovp_classic.geometry import pinhole
from geovp_classic.types import FloatArray, Intrinsics
from studies import image_cues
from studies.image_cues import CrossValidation, Scene
from tests.benchmarks.conftest import Says, write_kitti

ROADS = np.repeat(["a", "b", "c", "d"], 50)
CAMERA = Intrinsics(240.0, 240.0, 207.5, 49.5, 416, 128)
HEIGHT_M = 1.5
PITCH = 0.02


def road(obstacle_m: float | None = None) -> FloatArray:
    """Return the inverse depth [H, W] of a road that rises by PITCH, up to a wall 80 m ahead.

    An obstacle, 3 m wide and 10 m ahead, is so far to the right.
    """
    rays = pinhole.rays(CAMERA)
    ground = np.array([0.0, np.cos(PITCH), np.sin(PITCH)]) / HEIGHT_M
    inverse_depth = np.maximum(rays @ ground, 1 / 80)
    if obstacle_m is not None:
        is_obstacle = np.abs(10 * rays[..., 0] - obstacle_m) < 1.5
        is_obstacle &= np.abs(10 * rays[..., 1]) < 1.0
        inverse_depth = np.where(is_obstacle, 0.1, inverse_depth)
    return inverse_depth


def scene(inverse_depth: FloatArray) -> Scene:
    rays = pinhole.rays(CAMERA)
    ground = image_cues.fit_ground(inverse_depth, np.ones_like(inverse_depth), rays)
    assert ground is not None
    ahead = np.array([0.0, 0.0, 1.0])
    path = np.arange(1.0, 21.0)[:, None] * ahead
    return Scene(np.zeros_like(inverse_depth), inverse_depth, rays, ground, path, ahead)


def test_a_road_is_fitted_and_obstacles_push_arcs_away() -> None:
    free = scene(road())
    assert free.height_m == pytest.approx(HEIGHT_M, rel=0.01)
    assert image_cues.road_pitch(free) == pytest.approx(PITCH, abs=1e-3)
    assert image_cues.road_roll(free) == pytest.approx(0, abs=1e-3)
    assert np.abs(image_cues.height_profile(free)[:5]).max() < 0.05
    assert image_cues.free_arcs(free) == pytest.approx(0, abs=1e-6)
    assert image_cues.free_arcs(scene(road(-1.0)))[0] > np.radians(1)  # an obstacle on the left
    assert image_cues.free_arcs(scene(road(1.0)))[0] < -np.radians(1)


def test_mirrored_images_change_the_sign_of_one_cue() -> None:
    image = np.random.default_rng(0).random((128, 416))
    odd, even = image_cues.left_minus_right(image), image_cues.left_plus_right(image)
    np.testing.assert_allclose(image_cues.left_minus_right(image[:, ::-1]), -odd, atol=1e-9)
    np.testing.assert_allclose(image_cues.left_plus_right(image[:, ::-1]), even, atol=1e-9)


def explained(cue: FloatArray, residual: FloatArray) -> float:
    predicted = CrossValidation().predict(cue, residual, ROADS)
    return float(1 - ((residual - predicted) ** 2).mean() / (residual**2).mean())


def test_only_cues_that_hold_on_other_roads_explain_residuals() -> None:
    rng = np.random.default_rng(0)
    cue = rng.standard_normal((200, 5))
    residual = cue[:, :2] + 0.1 * rng.standard_normal((200, 2))
    assert explained(cue, residual) > 0.9
    assert explained(rng.standard_normal((200, 5)), residual) < 0.05
    sign = np.where(np.isin(ROADS, ["a", "b"]), 1.0, -1.0)[:, None]
    assert explained(cue, residual * sign) < 0.05  # within a road the cue tells all
    mounted = cue + 10 * (ROADS == "a")[:, None]
    assert explained(mounted, residual) > 0.9


def test_a_road_is_predicted_without_its_own_residuals() -> None:
    rng = np.random.default_rng(0)
    cue, residual = rng.standard_normal((200, 5)), rng.standard_normal((200, 2))
    is_tested = ROADS == "b"
    changed = np.where(is_tested[:, None], 7.0, residual)
    before, after = (CrossValidation().predict(cue, each, ROADS) for each in (residual, changed))
    np.testing.assert_array_equal(before[is_tested], after[is_tested])


def test_the_command_prints_a_row_per_cue(tmp_path: Path, printed: Says, refused: Says) -> None:
    clip = Synthetic(num_clips=1, num_frames=33, size_px=(128, 128))[0]
    names = ("01", "02", "03")
    for name in names:
        write_kitti(tmp_path, name, clip)
    ranges = ", ".join(f'"{name}"' for name in names)
    (tmp_path / "few.toml").write_text('ranges = ["01", "02"]')
    (tmp_path / "mine.toml").write_text(f"ranges = [{ranges}]")
    options = ["study", "image-cues", tmp_path, "--stride", "3", "--splits"]
    lines = printed(*options, tmp_path / "mine.toml").splitlines()
    rows = [line.split("|")[1].strip() for line in lines if line.startswith("| yaw:")]
    assert rows[0] == "yaw: residual (deg)"
    assert len(rows) == 2 + len(image_cues.CUES["yaw"])
    assert "3 or more" in refused(*options, tmp_path / "few.toml")
