"""A small street at 32x32 pixels and at 16x16, and SynSin small enough to learn it in seconds."""

from dataclasses import replace

import numpy as np
import pytest

from geovp_benchmarks.audit.contracts import street
from geovp_classic.geometry import pinhole
from geovp_classic.types import Clip
from geovp_learned.synsin.network import Architecture
from geovp_learned.synsin.train import SynSinTraining, Weights


def street_of(side_px: int) -> Clip:
    """Ten frames of the contracts' street, with true depths."""
    whole, size_px = street.clip(), (side_px, side_px)
    step_px = whole.frames.shape[1] // side_px
    return Clip(
        name="street",
        frames=np.stack([pinhole.resize(frame, size_px) for frame in whole.frames]),
        times_s=whole.times_s,
        intrinsics=whole.intrinsics.resized(*size_px),
        trajectory=whole.trajectory,
        depths=whole.depths[:, step_px // 2 :: step_px, step_px // 2 :: step_px],
    )


@pytest.fixture(scope="session")
def clip() -> Clip:
    return street_of(32)


@pytest.fixture(scope="session")
def tiny_clip() -> Clip:
    return street_of(16)


@pytest.fixture(scope="session")
def method() -> SynSinTraining:
    """SynSin without losses that need files or another network."""
    architecture = Architecture(
        features=8,
        width=16,
        feature_blocks=1,
        inner_blocks=1,
        noise_size=4,
        patch_px=2,
        depth_px=32,
        depth_channels=(16, 32, 32),
    )
    return SynSinTraining(
        architecture,
        Weights(content=0.0, adversarial=0.0, depth=1.0, reprojection=1.0, roughness=0.01),
        max_horizon=2,
        views=2,
        grey_probability=0.0,
        rate=1e-2,
    )


@pytest.fixture(scope="session")
def adversarial(method: SynSinTraining) -> SynSinTraining:
    """The same with a small discriminator."""
    return replace(method, weights=replace(method.weights, adversarial=0.1), discriminator_width=8)
