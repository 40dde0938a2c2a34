"""Each protocol's numbers against scikit-image, and how a matrix follows a protocol by name."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from skimage.metrics import structural_similarity

from geovp_benchmarks.matrix import papers, schema
from geovp_classic import registry
from geovp_classic.errors import GeovpError
from geovp_classic.types import ByteArray

Definition = Callable[[np.ndarray, np.ndarray], float]  # of two frames [H, W, 3] in 0..1


def frames() -> tuple[ByteArray, ByteArray]:
    """A prediction and a target [2, 176, 240, 3]: waves, shifted and fainter in the prediction,
    which is noisy.
    """
    rng = np.random.default_rng(11)
    v, u = np.mgrid[:176, :240]
    base = 127 + 60 * np.stack(
        [np.sin(u / 7 + v / 11), np.cos(u / 13 - v / 5), np.sin(u * v / 900)], axis=-1
    )
    target = np.stack([base, np.roll(base, 5, axis=0)]) + rng.normal(0, 8, (2, *base.shape))
    predicted = np.roll(target, 2, axis=2) * [0.9, 1.0, 0.7] + rng.normal(0, 15, target.shape)
    return tuple(np.clip(each, 0, 255).round().astype(np.uint8) for each in (predicted, target))  # type: ignore[return-value]


def joint_psnr(x: np.ndarray, y: np.ndarray) -> float:
    return float(-10 * np.log10(((x - y) ** 2).mean()))


def psnr_per_channel(x: np.ndarray, y: np.ndarray) -> float:
    return float(np.mean([-10 * np.log10(((x[..., c] - y[..., c]) ** 2).mean()) for c in range(3)]))


def structural(
    x: np.ndarray, y: np.ndarray, scale: float = 1.0, border_px: int = 0, **settings: Any
) -> float:
    """Return scikit-image's mean over windows of frames that are continued by zeros."""
    border = ((border_px, border_px), (border_px, border_px), (0, 0))
    padded = np.pad(x, border), np.pad(y, border)
    return float(structural_similarity(*padded, data_range=scale, channel_axis=-1, **settings))


GAUSSIAN = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
gaussian_ssim = functools.partial(structural, **GAUSSIAN)
zero_padded_ssim = functools.partial(structural, border_px=5, **GAUSSIAN)
# windows of 7x7 equal weights, variances divided by 48 instead of 49, and L = 2 for fractions
old_scikit_ssim = functools.partial(structural, scale=2.0)


DEFINITIONS: dict[str, dict[str, Definition]] = {
    "thesis": {"psnr": joint_psnr, "ssim": gaussian_ssim},
    "svg18": {"psnr": psnr_per_channel, "ssim": old_scikit_ssim},
    "srvp20": {"psnr": psnr_per_channel, "ssim": gaussian_ssim},
    "synsin20": {"psnr": joint_psnr, "ssim": zero_padded_ssim},
    "openstl": {"psnr": joint_psnr, "ssim": old_scikit_ssim},
}


@pytest.mark.parametrize(
    ("protocol", "column"),
    [(name, column) for name, each in DEFINITIONS.items() for column in each],
)
def test_values_agree_with_the_definition_to_the_fourth_decimal(protocol: str, column: str) -> None:
    predicted, target = frames()
    metric = registry.build("frame_metrics", papers.load(protocol).metrics["frame"][column])
    expected = [
        DEFINITIONS[protocol][column](p / 255, t / 255)
        for p, t in zip(predicted, target, strict=True)
    ]
    np.testing.assert_allclose(metric(predicted, target, None), expected, atol=2e-5)


def test_fvs20_is_ms_ssim_and_lpips_in_both_orders() -> None:
    predicted, target = frames()
    metrics = papers.load("fvs20").metrics["frame"]
    assert list(metrics) == ["ms-ssim", "lpips", "lpips-bgr"]
    # pytorch-msssim 1.0.0, ms_ssim(..., data_range=1.0), on the same frames
    values = registry.build("frame_metrics", metrics["ms-ssim"])(predicted, target, None)
    np.testing.assert_allclose(values, [0.87857273, 0.87912317], atol=2e-6)
    assert metrics["lpips-bgr"] == {"name": "lpips", "channels": "bgr"}


FOLLOWS = {"protocol": {"name": "fvs20", "root": "raw"}, "predictors": {"copy-last": "copy-last"}}


def test_what_stands_beside_the_name_replaces_the_protocols_choice() -> None:
    own = {"name": "kitti", "sequences": ["06"], "fit": "stretch"}
    protocol = {"name": "fvs20", "root": "odometry", "stride": 14, "dataset": own}
    parsed = schema.parse("m", {**FOLLOWS, "protocol": protocol, "metrics": {"frame": ["psnr"]}})
    assert (parsed.dataset, parsed.root) == (own, Path("odometry"))
    assert (parsed.num_past, parsed.stride) == (4, 14)
    assert list(parsed.metrics["frame"]) == ["psnr"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("fvs", "no protocol 'fvs': did you mean 'fvs20'"),
        (20, "unknown key 'name'"),
    ],
)
def test_a_protocol_that_cannot_be_followed_is_told(name: object, message: str) -> None:
    with pytest.raises(GeovpError, match=message):
        schema.parse("m", {**FOLLOWS, "protocol": {"name": name}})


@pytest.mark.parametrize("name", papers.names())
def test_every_protocol_gives_a_matrix_whose_metrics_can_be_built(name: str) -> None:
    protocol = {"name": name, "root": "somewhere", "dataset": "synthetic"}
    parsed = schema.parse(name, {**FOLLOWS, "protocol": protocol})
    assert parsed.num_future == papers.load(name).num_future
    for spec in parsed.metrics["frame"].values():
        if spec["name"] != "lpips":  # needs torch
            assert registry.build("frame_metrics", spec).protocol
