"""The three methods, small enough to learn something in seconds, and worlds to learn."""

import pytest
import street

from geovp_classic.types import ByteArray
from geovp_learned.video import slamp, srvp, svg, training
from geovp_learned.video.autoencoder import AutoencoderConfig
from geovp_learned.video.slamp import SlampTraining
from geovp_learned.video.srvp import SrvpTraining
from geovp_learned.video.svg import SvgTraining
from geovp_learned.video.training import VideoTraining

CODING = AutoencoderConfig(style="dcgan", size_px=16, width=8, code_size=16)
NUM_PAST, NUM_FUTURE = 3, 3


@pytest.fixture(params=["svg", "srvp", "slamp"])
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def method(name: str) -> VideoTraining:
    common = {"num_past": NUM_PAST, "num_future": NUM_FUTURE, "rate": 5e-3, "grey_probability": 0.0}
    if name == "svg":
        return SvgTraining(**common, architecture=svg.Architecture(CODING, 24, latent_size=4))
    if name == "srvp":
        shape = srvp.Architecture(
            CODING,
            inference_size=24,
            residual_size=32,
            state_size=12,
            latent_size=4,
            first_frames=2,
        )
        return SrvpTraining(**common, architecture=shape, observation_std=0.1)
    return SlampTraining(
        **common, architecture=slamp.Architecture(CODING, 24, latent_size=4, mask_width=8)
    )


@pytest.fixture(scope="session")
def street_window() -> ByteArray:
    """Six frames [6, 16, 16, 3] of the contracts' street."""
    return training.resize(street.clip().frames[:6], 16, 16)
