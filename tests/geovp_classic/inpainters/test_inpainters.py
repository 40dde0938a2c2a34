"""Guarantees of all inpainters, and the pixels that each of them copies."""

import numpy as np
import pytest

from geovp_classic.errors import BadData
from geovp_classic.inpainters.blank import Blank
from geovp_classic.inpainters.detail_transfer import DetailTransfer
from geovp_classic.inpainters.nearest_background import NearestBackground
from geovp_classic.inpainters.telea import Telea
from geovp_classic.interfaces import Inpainter
from geovp_classic.types import ByteArray, FloatArray, Views

INPAINTERS = [Blank(), NearestBackground(), Telea(), DetailTransfer(strength=0.5)]


def views_of(covered: FloatArray, depths: FloatArray, greys: FloatArray) -> Views:
    depths = np.where(covered, depths, 0).astype(np.float32)
    frames = np.repeat(np.asarray(greys)[..., None], 3, axis=-1).astype(np.uint8)
    return Views(frames, np.asarray(covered, bool), depths)


def random_views(fractions: list[float]) -> Views:
    """Return views with those fractions of covered pixels."""
    rng = np.random.default_rng(4)
    size = (len(fractions), 9, 11)
    covered = rng.random(size) < np.array(fractions)[:, None, None]
    return views_of(covered, rng.uniform(1, 9, size), rng.integers(0, 255, size))


def inpaint(inpainter: Inpainter, views: Views) -> ByteArray:
    """Return inpainted frames after a last frame of grey 7."""
    return inpainter.inpaint(views, np.full(views.frames.shape[1:], 7, np.uint8))


@pytest.mark.parametrize(
    ("greys", "covered", "depths", "expected"),
    [
        ([10, 99, 99, 99, 50], [1, 0, 0, 0, 1], [5, 0, 0, 0, 20], [10, 50, 50, 50, 50]),
        ([10, 99, 99, 99, 50], [1, 0, 0, 0, 1], [np.inf, 0, 0, 0, 20], [10, 10, 10, 10, 50]),
        ([0, 10, 0, 0, 0, 0, 50, 0], [0, 1, 0, 0, 0, 0, 1, 0], [7] * 8, [10] * 4 + [50] * 4),
    ],
)
def test_a_hole_takes_the_farther_side_and_of_equal_ones_the_nearer(
    greys: list[int], covered: list[int], depths: list[float], expected: list[int]
) -> None:
    row = [np.array(values, float)[None, None] for values in (covered, depths, greys)]
    assert inpaint(NearestBackground(), views_of(*row))[0, 0, :, 0].tolist() == expected
    column = [values.transpose(0, 2, 1) for values in row]
    inpainted = inpaint(NearestBackground(), views_of(*column))[0, :, 0, 0]
    assert inpainted.tolist() == expected


def test_telea_continues_a_gradient() -> None:
    gradient = np.tile(np.linspace(20, 200, 20), (1, 20, 1))
    covered = np.ones((1, 20, 20))
    covered[0, 8:12, 8:12] = 0
    views = views_of(covered, covered, np.where(covered, gradient, 0))
    assert np.abs(inpaint(Telea(), views)[..., 0] - gradient).max() < 30


@pytest.mark.parametrize(("difference", "part"), [(0, 1.0), (60, np.exp(-1)), (-90, np.exp(-2.25))])
def test_colours_come_from_the_border_and_detail_from_a_similar_last_frame(
    difference: int, part: float
) -> None:
    """The view is covered on the left only; the last frame is striped, with a mean of 120."""
    covered = np.ones((1, 64, 64))
    covered[0, :, 32:] = 0
    striped = np.tile((100 + 40 * (np.arange(64) % 2))[:, None], (64, 1, 3)).astype(np.uint8)
    plain = views_of(covered, np.ones((1, 64, 64)), np.full((1, 64, 64), 120 + difference))
    inpainted = DetailTransfer(strength=0.5).inpaint(plain, striped)[0, :, 34:, 0].astype(float)
    assert inpainted.mean() == pytest.approx(120 + difference, abs=1)
    assert np.abs(np.diff(inpainted, axis=1)).mean() == pytest.approx(part * 0.5 * 40, abs=1)


def test_an_uncovered_view_is_the_last_frame_with_all_its_detail() -> None:
    last = np.random.default_rng(1).integers(0, 255, (9, 11, 3), np.uint8)
    for inpainter in (NearestBackground(), Telea(), DetailTransfer()):
        np.testing.assert_array_equal(inpainter.inpaint(random_views([0.0]), last)[0], last)


@pytest.mark.parametrize(
    "settings", [{"coarse_fraction": 1.0}, {"strength": -0.1}, {"colour_difference": 0}]
)
def test_bad_settings_are_refused(settings: dict[str, float]) -> None:
    with pytest.raises(BadData, match=next(iter(settings))):
        DetailTransfer(**settings)


@pytest.mark.parametrize("inpainter", INPAINTERS, ids=lambda inpainter: type(inpainter).__name__)
class TestAllInpainters:
    def test_views_are_independent(self, inpainter: Inpainter) -> None:
        views = random_views([0.9, 0.5, 0.2])
        together = inpaint(inpainter, views)
        for k in range(3):
            part = slice(k, k + 1)
            alone = Views(views.frames[part], views.covered[part], views.depths[part])
            np.testing.assert_array_equal(inpaint(inpainter, alone)[0], together[k])
