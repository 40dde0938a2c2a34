from __future__ import annotations

import numpy as np
import pytest

from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.inpainters.blank import Blank
from geovp_classic.inpainters.detail_transfer import DetailTransfer
from geovp_classic.inpainters.nearest_background import NearestBackground
from geovp_classic.inpainters.telea import Telea
from geovp_classic.interfaces import Inpainter
from geovp_classic.types import ByteArray, Views

FILLS = [
    Blank(),
    NearestBackground(),
    Telea(),
    DetailTransfer(strength=0.5),
]


def views(covered: np.ndarray, depths: np.ndarray, frames: np.ndarray) -> Views:
    depths = np.where(covered, depths, 0).astype(np.float32)
    return Views(
        np.repeat(frames[..., None], 3, axis=-1).astype(np.uint8), covered.astype(bool), depths
    )


def fill_in(inpainter: Inpainter, given: Views, last: int = 7) -> ByteArray:
    """The views filled, after a last frame that was of one grey."""
    return inpainter.inpaint(given, np.full(given.frames.shape[1:], last, np.uint8))


def test_a_hole_takes_the_colour_of_the_farther_side() -> None:
    frames = np.array([[[10, 99, 99, 99, 50]], [[10, 99, 99, 99, 50]]])
    covered = np.array([[[1, 0, 0, 0, 1]]] * 2)
    depths = np.array([[[5, 0, 0, 0, 20]], [[np.inf, 0, 0, 0, 20]]])
    filled = fill_in(NearestBackground(), views(covered, depths, frames))[..., 0]
    assert filled.tolist() == [[[10, 50, 50, 50, 50]], [[10, 10, 10, 10, 50]]]


def test_equally_far_sides_share_the_hole_and_borders_have_one_side_only() -> None:
    frames = np.array([[[0, 10, 0, 0, 0, 0, 50, 0]]])
    covered = np.array([[[0, 1, 0, 0, 0, 0, 1, 0]]])
    filled = fill_in(NearestBackground(), views(covered, np.full((1, 1, 8), 7.0), frames))[
        0, 0, :, 0
    ]
    assert filled.tolist() == [10, 10, 10, 10, 50, 50, 50, 50]


def test_an_empty_row_takes_the_farther_row() -> None:
    frames = np.array([[[10], [0], [0], [50]]])
    covered = np.array([[[1], [0], [0], [1]]])
    filled = fill_in(NearestBackground(), views(covered, np.array([[[9], [0], [0], [3]]]), frames))[
        0, :, 0, 0
    ]
    assert filled.tolist() == [10, 10, 10, 50]


def test_inpainting_goes_on_with_what_surrounds_the_hole() -> None:
    frames = np.tile(np.linspace(20, 200, 20), (1, 20, 1))
    covered = np.ones((1, 20, 20))
    covered[0, 8:12, 8:12] = 0
    filled = fill_in(Telea(), views(covered, np.ones((1, 20, 20)), np.where(covered, frames, 0)))[
        ..., 0
    ]
    assert np.abs(filled.astype(float) - frames).max() < 30


def test_broad_colours_come_from_the_border_and_detail_from_the_last_frame() -> None:
    # The view is dark and seen on the left only, the last observed frame is striped.
    covered = np.ones((1, 64, 64))
    covered[0, :, 32:] = 0
    striped = np.tile((100 + 40 * (np.arange(64) % 2))[:, None], (64, 1, 3)).astype(np.uint8)
    dark = views(covered, np.ones((1, 64, 64)), np.full((1, 64, 64), 50))
    invented = DetailTransfer(strength=0.5).inpaint(dark, striped)[0, :, 34:, 0].astype(float)
    assert invented.mean() == pytest.approx(50, abs=1)
    assert np.abs(np.diff(invented, axis=1)).mean() == pytest.approx(0.5 * 40, abs=1)


@pytest.mark.parametrize(
    "settings", [{"coarse_share": 0.0}, {"coarse_share": 1.0}, {"strength": -0.1}]
)
def test_settings_that_borrow_nothing_sensible_are_refused(settings: dict[str, float]) -> None:
    with pytest.raises(BadData, match="expected a share between 0 and 1"):
        DetailTransfer(**settings)


@pytest.mark.parametrize("inpainter", FILLS, ids=lambda inpainter: type(inpainter).__name__)
class TestEveryFill:
    def test_covered_pixels_stay_and_input_is_not_touched(self, inpainter: Inpainter) -> None:
        rng = np.random.default_rng(4)
        covered = rng.random((3, 9, 11)) < 0.6
        given = views(
            covered, rng.uniform(1, 9, covered.shape), rng.integers(0, 255, covered.shape)
        )
        before = given.frames.copy()
        filled = fill_in(inpainter, given)
        assert filled.dtype == np.uint8
        np.testing.assert_array_equal(filled[covered], given.frames[covered])
        np.testing.assert_array_equal(given.frames, before)

    def test_garbage_under_the_hole_makes_no_difference(self, inpainter: Inpainter) -> None:
        rng = np.random.default_rng(5)
        covered = rng.random((1, 9, 11)) < 0.6
        depths, frames = rng.uniform(1, 9, covered.shape), rng.integers(0, 255, covered.shape)
        other = np.where(covered, frames, 255 - frames)
        np.testing.assert_array_equal(
            fill_in(inpainter, views(covered, depths, frames)),
            fill_in(inpainter, views(covered, depths, other)),
        )

    def test_with_nothing_covered_it_is_the_last_frame(self, inpainter: Inpainter) -> None:
        nothing = np.zeros((2, 5, 6))
        assert (
            fill_in(inpainter, views(nothing, nothing, nothing + 77))
            == (0 if inpainter == Blank() else 7)
        ).all()

    def test_everything_covered_is_left_alone(self, inpainter: Inpainter) -> None:
        everything = np.ones((1, 5, 6))
        assert (fill_in(inpainter, views(everything, everything, everything * 77)) == 77).all()

    def test_survives_the_registry(self, inpainter: Inpainter) -> None:
        assert isinstance(inpainter, Inpainter)
        assert registry.build("inpainters", registry.describe(inpainter)) == inpainter


@pytest.mark.parametrize("inpainter", FILLS, ids=lambda inpainter: type(inpainter).__name__)
def test_every_view_is_filled_from_itself_alone(inpainter: Inpainter) -> None:
    rng = np.random.default_rng(6)
    covered = rng.random((3, 9, 11)) < np.array([0.9, 0.5, 0.2])[:, None, None]
    depths, frames = rng.uniform(1, 9, covered.shape), rng.integers(0, 255, covered.shape)
    together = fill_in(inpainter, views(covered, depths, frames))
    for k in range(3):
        alone = fill_in(inpainter, views(covered[k : k + 1], depths[k : k + 1], frames[k : k + 1]))
        np.testing.assert_array_equal(alone[0], together[k])
