"""Depth maps of other software, with the exact depth of a rendered street in the place of theirs."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import street

from geovp_classic import registry
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.observation import Observer
from geovp_classic.types import BoolArray, FloatArray

CLIP = replace(street.clip(), name="street/000003")
NUM_PAST = 6
LAST = 8  # number of the last observed frame in the sequence
TRUTH = 1 / CLIP.depths[NUM_PAST - 1]  # [H, W]


def estimate(
    path: Path, mask: BoolArray | None = None, **settings: Any
) -> tuple[FloatArray, FloatArray]:
    """Return inverse depth and confidence [H, W] of the last observed frame."""
    source = registry.build(
        "depth_sources", {"name": "recorded", "path": str(path), "frames": "crop", **settings}
    )
    context, _ = CLIP.split(NUM_PAST, source.needs)
    if mask is not None:
        context = Observer(mask=mask, mask_mode="replace").observe(context).context
    past = replace(CLIP.trajectory[:NUM_PAST], is_metric=not settings.get("align"))
    inverse_depths, confidence = source.inverse_depths(context, past)
    return inverse_depths[-1], confidence[-1]


def test_maps_of_uncropped_frames_are_cropped_and_resized(tmp_path: Path) -> None:
    (tmp_path / "street").mkdir()
    depth = CLIP.depths[NUM_PAST - 1].copy()
    depth[:20] = 0
    wide = np.pad(depth, ((0, 0), (30, 30))).repeat(3, axis=0).repeat(3, axis=1)
    np.savez(tmp_path / f"street/{LAST:06d}.npz", wide)
    inverse_depth, confidence = estimate(tmp_path / "{sequence}", frames="full")
    np.testing.assert_allclose(inverse_depth[20:], TRUTH[20:], rtol=1e-6)
    assert (confidence[:20] == 0).all()
    assert (confidence[20:] == 1).all()


def test_maps_are_reduced_to_the_scene_as_the_frames_are(tmp_path: Path) -> None:
    """A mask over the lower quarter and the left tenth leaves a window."""
    np.savez(tmp_path / f"{LAST}.npz", CLIP.depths[NUM_PAST - 1])
    height, width = TRUTH.shape
    mask = np.zeros(TRUTH.shape, bool)
    mask[3 * height // 4 :] = mask[:, : width // 10] = True
    inverse_depth, _ = estimate(tmp_path, mask)
    np.testing.assert_allclose(inverse_depth, TRUTH[: 3 * height // 4, width // 10 :], rtol=1e-6)


def test_16_bit_images_hold_multiples_of_a_unit(tmp_path: Path) -> None:
    """256 values per metre, as KITTI's depth; 100 m and more are not stored."""
    depth = CLIP.depths[NUM_PAST - 1]
    is_near = depth < 100
    stored = np.where(is_near, np.rint(256 * np.minimum(depth, 100)), 0).astype(np.uint16)
    cv2.imwrite(str(tmp_path / f"{LAST}.png"), stored)
    inverse_depth, confidence = estimate(tmp_path, unit=1 / 256)
    np.testing.assert_allclose(inverse_depth[is_near], TRUTH[is_near], rtol=2e-3)
    np.testing.assert_array_equal(confidence > 0, is_near)


def test_exr_files_hold_disparities(tmp_path: Path) -> None:
    openexr = pytest.importorskip("OpenEXR")
    disparity = (150 * 0.5 * TRUTH).astype(np.float32)  # focal length in pixels, baseline in metres
    openexr.File({}, {"Z": disparity}).write(str(tmp_path / f"{LAST:06d}.exr"))
    inverse_depth, _ = estimate(tmp_path, values="disparity", unit=1 / (150 * 0.5))
    np.testing.assert_allclose(inverse_depth, TRUTH, rtol=1e-5, atol=1e-9)


def test_relative_maps_are_aligned_with_multi_view_depth(tmp_path: Path) -> None:
    relative = 40 * TRUTH + 3
    relative[:, :15] = 9  # the network is wrong there
    np.savez(tmp_path / f"{LAST:06d}.npz", relative)
    inverse_depth, _ = estimate(tmp_path, values="inverse-depth", align=True)
    error = np.abs(inverse_depth - TRUTH)[:, 15:]
    assert error.max() < 0.05 * TRUTH.max()


def test_errors_say_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(BadData, match="no depth map of frame 8"):
        estimate(tmp_path)
    np.savez(tmp_path / f"{LAST:06d}.npz", TRUTH)
    source = registry.build("depth_sources", {"name": "recorded", "path": str(tmp_path)})
    context, _ = CLIP.split(NUM_PAST, source.needs)
    with pytest.raises(Incompatible, match="align = true"):
        source.inverse_depths(context, replace(CLIP.trajectory[:NUM_PAST], is_metric=False))
