"""SynSin computes what the authors' own code computes; `originals` says how the numbers were made.

pytorch3d was replaced by a rasteriser and a compositor of a few lines, which follow its
documentation: pixels have the nearest 128 points within the radius. The input is 256x256 with the
camera of data/kitti.py; the motion is MOTION, its length divided by the network's unit and its z
axis mirrored as z_buffer_manipulator.py demands. All noise is HALF.
"""

import math

import pytest
import torch

from geovp_learned.synsin import discriminator
from geovp_learned.synsin.discriminator import MultiScaleDiscriminator
from geovp_learned.synsin.generator import Generator
from geovp_learned.synsin.network import NOISE_SIZE, Architecture
from tests.learned.originals import HALF, digest, numbers, random_images, seed_weights

TOLERANCE = 1e-4
CAMERA = torch.tensor([[718.9, 718.9, 127.5, 127.5]])
YAW_RAD = 0.03
MOTION = torch.tensor(
    [
        [math.cos(YAW_RAD), 0.0, math.sin(YAW_RAD), 0.3],
        [0.0, 1.0, 0.0, 0.1],
        [-math.sin(YAW_RAD), 0.0, math.cos(YAW_RAD), -1.5],
        [0.0, 0.0, 0.0, 1.0],
    ]
)[None]  # metres


FEATURES = numbers(
    """-0.066189 1.074601 -0.165084 1.439562 -0.082961 1.040133 0.626375 -0.114737 0.231726 -0.52052 1.945028 1.129186 -2.244536 1.193206 -0.051145 0.182683 -0.419194 -0.690475 -0.253782 -0.598548 0.646537 -0.079233 -0.15763 -1.298143"""
)
CASES = {
    # --use_inverse_depth: 1 / depth = 10 sigmoid + .01, in units of 50 m
    "kitti": (
        Architecture(focal_px=718.9),
        numbers(
            """4.166862 4.450865 4.54387 3.784612 4.23193 4.123387 3.406658 4.295537 4.480203 4.262394 4.278277 4.058616 4.317369 4.390059 4.006037 3.874049 4.227686 4.24478 4.063107 4.396157 4.265823 4.12584 4.038571 3.476648"""
        ),
        numbers(
            """0.345586 0.098706 0.286216 0.062822 0.007597 0.092736 0.313481 0.332125 0.360576 0.096731 0.010472 0.08509 0.086935 0.012618 0.333891 0.094579 0.088193 0.105053 0.008473 0.091981 0.07579 0.327755 0.011099 0.01028"""
        ),
    ),
    # depth = (100 - 1) sigmoid + 1, in units of a metre
    "realestate": (
        Architecture(unit_m=1.0, depth_range=(1.0, 100.0)),
        numbers(
            """0.023723 0.02224 0.021793 0.026063 0.023366 0.023968 0.028879 0.023027 0.022097 0.023203 0.023118 0.024342 0.022913 0.022542 0.024654 0.025475 0.023389 0.023297 0.024316 0.022511 0.023184 0.023954 0.02446 0.028313"""
        ),
        numbers(
            """0.312636 0.103283 0.321877 0.07989 0.009459 0.094067 0.266787 0.328913 0.363988 0.095921 0.009008 0.09962 0.092923 0.01064 0.32347 0.082484 0.088552 0.112244 0.008395 0.099319 0.080009 0.311763 0.010294 0.008502"""
        ),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_depths_features_and_views_are_those_of_the_authors_code(name: str) -> None:
    architecture, inverse_depths, image = CASES[name]
    generator = Generator(architecture).eval()
    for network, count in zip(generator.children(), (431_064, 9_795_137, 3_578_066), strict=True):
        seed_weights(network)
        assert sum(parameter.numel() for parameter in network.parameters()) == count
    noise = torch.full((1, NOISE_SIZE), HALF)
    with torch.no_grad():
        cloud = generator.encode(random_images(1, 3, 256, 256), CAMERA, noise)
        views = generator.render(cloud, MOTION, CAMERA, (256, 256), noise)
    in_units = cloud.inverse_depths * architecture.unit_m
    assert digest(in_units) == pytest.approx(inverse_depths, abs=TOLERANCE)
    assert digest(cloud.features.transpose(1, 2)) == pytest.approx(FEATURES, abs=TOLERANCE)
    assert digest(views.frames) == pytest.approx(image, abs=TOLERANCE)


def test_adversarial_losses_are_those_of_the_authors_code() -> None:
    """compute_generator_loss and compute_discrimator_loss of gan_loss.py, with lambda_feat 10."""
    critic = MultiScaleDiscriminator(64).eval()
    seed_weights(critic)
    fake, real = random_images(4, 3, 64, 64).chunk(2)
    with torch.no_grad():
        losses = discriminator.generator_losses(critic, fake, real)
        loss = discriminator.discriminator_hinge_loss(critic(real), critic(fake))
    assert float(losses["adversarial"]) == pytest.approx(-0.382165, abs=TOLERANCE)
    # 10 times the sum over four layers is 40 times their mean
    assert 40 * float(losses["feature_matching"]) == pytest.approx(22.45997, rel=TOLERANCE)
    assert float(loss) == pytest.approx(2.126881, abs=TOLERANCE)
