"""Camera-fixed pixels: found where textured pixels stay in place, and nowhere without evidence."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.geometry import pinhole
from geovp_classic.observation import Observer, observations_of
from geovp_classic.observation.camera_fixed import CameraFixedDetection
from geovp_classic.odometry.features import CornerTracker
from geovp_classic.types import BoolArray, ByteArray, Clip, PrivilegedInput

SIDE = 192


@pytest.fixture(scope="module")
def street() -> Clip:
    """Ten observed frames and one to predict of a street."""
    return Synthetic(seed=3, num_clips=1, num_frames=11, size_px=(SIDE, SIDE))[0]


def hood() -> BoolArray:
    """An arch that covers a fifth of the middle column and a tenth of the outer ones."""
    row, column = np.mgrid[:SIDE, :SIDE]
    arch = 1 - 0.5 * (2 * column / (SIDE - 1) - 1) ** 2
    return np.asarray(row >= SIDE * (1 - 0.2 * arch))


def pillar() -> BoolArray:
    """A slanted pillar at the left border."""
    row, column = np.mgrid[:SIDE, :SIDE]
    return np.asarray((column < 50 - row / 5) & (column > 20 - row / 5))


def stamp() -> tuple[BoolArray, BoolArray]:
    """The box of a time stamp in the lower right, and its bright digits."""
    box, digits = np.zeros((SIDE, SIDE), np.uint8), np.zeros((SIDE, SIDE), np.uint8)
    box[130:146, 90:180] = 1
    cv2.putText(digits, "12:34:56", (92, 143), cv2.FONT_HERSHEY_SIMPLEX, 0.6, 1, 2)
    return box > 0, digits > 0


def painted(frames: ByteArray, mask: BoolArray, colour: tuple[int, int, int]) -> ByteArray:
    """The frames with an object of one colour and noise."""
    noise = np.random.default_rng(0).normal(colour, 1.0, frames.shape).clip(0, 255)
    return np.where(mask[..., None], noise, frames).astype(np.uint8)


def detected(frames: ByteArray) -> BoolArray:
    greys = np.stack([pinhole.grey8(frame) for frame in frames])
    return CameraFixedDetection().detect(greys)


def precision_and_recall(mask: BoolArray, truth: BoolArray) -> tuple[float, float]:
    hits = float((mask & truth).sum())
    return hits / max(mask.sum(), 1), hits / truth.sum()


@pytest.mark.parametrize("is_stamped", [False, True])
@pytest.mark.parametrize("is_framed", [False, True])
@pytest.mark.parametrize("is_hooded", [False, True])
def test_hood_pillar_and_time_stamp_are_detected(
    street: Clip, is_hooded: bool, is_framed: bool, is_stamped: bool
) -> None:
    frames, truth = street.frames[:10], np.zeros((SIDE, SIDE), bool)
    for is_shown, mask, colour in (
        (is_stamped, stamp()[0], (20, 20, 20)),
        (is_stamped, stamp()[1], (240, 240, 240)),
        (is_hooded, hood(), (30, 40, 120)),
        (is_framed, pillar(), (15, 15, 15)),
    ):
        if is_shown:
            frames, truth = painted(frames, mask, colour), truth | mask
    mask = detected(frames)
    if not truth.any():
        assert not mask.any()
        return
    precision, recall = precision_and_recall(mask, truth)
    assert precision > 0.9
    assert recall > 0.8


def test_a_plain_region_inside_a_textured_hood_is_a_part_of_it(street: Clip) -> None:
    texture = np.random.default_rng(1).integers(20, 200, (SIDE // 4, SIDE // 4, 1), np.uint8)
    texture = cv2.resize(texture, (SIDE, SIDE), interpolation=cv2.INTER_NEAREST)[..., None]
    plain = np.zeros((SIDE, SIDE), bool)
    plain[165:184, 70:120] = True
    frames = np.where(hood()[..., None], texture, street.frames[:10])
    frames = painted(frames, plain, (90, 90, 90))
    mask = detected(frames)
    assert mask[165:184, 70:120].mean() > 0.9
    assert precision_and_recall(mask, hood())[0] > 0.9


def test_digits_without_a_box_are_detected(street: Clip) -> None:
    """Their gaps show the scene, and count as camera-fixed where they are narrow."""
    box, digits = stamp()
    mask = detected(painted(street.frames[:10], digits, (240, 240, 240)))
    assert mask[digits].mean() > 0.8
    assert mask[~box].mean() < 0.005


def test_the_street_itself_is_not_camera_fixed() -> None:
    """The car shakes, so that neither far scenery nor edges along the road stay in place."""
    for clip in Synthetic(seed=5, num_clips=4, num_frames=10, size_px=(128, 128)):
        assert not detected(clip.frames).any()


def test_a_smooth_road_that_seems_to_stay_is_not_camera_fixed(street: Clip) -> None:
    """Without texture there is no evidence, below a hood's edge or without one."""
    smooth = np.zeros((SIDE, SIDE), bool)
    smooth[SIDE * 6 // 10 :] = True
    road = painted(street.frames[:10], smooth, (120, 120, 120))
    assert not detected(road).any()
    mask = detected(painted(road, hood(), (30, 40, 120)))
    assert mask[smooth & ~hood()].mean() < 0.06


def test_a_stationary_camera_and_few_frames_give_no_evidence(street: Clip) -> None:
    frames = painted(street.frames[:10], hood(), (30, 40, 120))
    assert detected(frames).any()
    assert not detected(np.repeat(frames[:1], 10, axis=0)).any()
    assert not detected(frames[:3]).any()


def test_a_stationary_camera_behind_a_passing_bus_has_no_mask(street: Clip) -> None:
    """Most of the image stays in place: it is the street."""
    frames = np.repeat(street.frames[:1], 10, axis=0)
    bus = np.random.default_rng(0).integers(0, 255, (40, 60, 3), np.uint8)
    bus = cv2.resize(bus, (140, 100), interpolation=cv2.INTER_NEAREST)
    for step, frame in enumerate(frames):
        frame[60:160, 4 * step : 4 * step + 140] = bus
    assert not detected(frames).any()


def test_a_time_stamp_leaves_the_window_whole_and_has_no_corners(street: Clip) -> None:
    box, digits = stamp()
    frames = painted(painted(street.frames, box, (20, 20, 20)), digits, (240, 240, 240))
    context, _ = replace(street, frames=frames).split(10, PrivilegedInput.NONE)
    observed = Observer().observe(context)
    assert observed.context.intrinsics == context.intrinsics
    observations = observations_of(observed.context, "crop")
    assert observations.mask[box].mean() > 0.8
    corners = CornerTracker().detect(observations.greys[-1])
    allowed = CornerTracker().detect(observations.greys[-1], observations.mask)
    columns, rows = corners.astype(int).T
    assert box[rows, columns].any()
    columns, rows = allowed.astype(int).T
    assert not observations.mask[rows, columns].any()
    assert len(allowed) > 0.8 * len(corners)


def test_a_given_mask_adds_to_detection_or_replaces_it(street: Clip, tmp_path: Path) -> None:
    given = np.zeros((SIDE, SIDE), np.uint8)
    given[:40] = 255
    path = tmp_path / "mask.png"
    cv2.imwrite(str(path), given)
    frames = painted(street.frames, hood(), (30, 40, 120))
    context, _ = replace(street, frames=frames).split(10, PrivilegedInput.NONE)
    detected_mask = Observer().observe(context).mask
    assert detected_mask[hood()].mean() > 0.8
    added = Observer(mask=path).observe(context).mask
    np.testing.assert_array_equal(added, detected_mask | (given > 0))
    replaced = Observer(mask=path, mask_mode="replace").observe(context).mask
    np.testing.assert_array_equal(replaced, given > 0)
    assert not Observer(camera_fixed=None).observe(context).mask.any()
