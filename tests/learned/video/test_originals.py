"""SVG, SRVP and SLAMP compute what the authors' own code computes; `originals` says how the numbers
were made.
"""

import dataclasses
import functools

import pytest
import torch
from torch import Tensor, nn

from geovp_learned.video import slamp, srvp, svg
from geovp_learned.video.autoencoder import AutoencoderConfig
from geovp_learned.video.training import VideoTraining
from tests.learned.originals import (
    HALF,
    digest,
    half_a_deviation,
    numbers,
    random_images,
    seed_weights,
)

TOLERANCE = 1e-4


@dataclasses.dataclass(frozen=True)
class Case:
    """A method with the authors' sizes, and what their code gives: parameters, numbers of a
    prediction, and loss terms under their names.
    """

    method: VideoTraining
    num_clips: int
    parameters: int
    prediction: list[float]
    losses: dict[str, float]
    step: int = 0


def coding(
    style: str, size_px: int = 64, colours: int = 3, code_size: int = 128
) -> AutoencoderConfig:
    return AutoencoderConfig(style, size_px, 64, code_size, colours)


SRVP = functools.partial(
    srvp.SrvpTraining,
    num_past=5,
    num_future=3,
    observation_std=0.2,
    beta_first=0.5,
    beta=2.0,
    residual_weight=1.5,
)
CASES = {
    # models/vgg_64.py, dcgan_64.py and vgg_128.py, models/lstm.py; train() of train_svg_lp.py
    "svg-vgg": Case(
        svg.SvgTraining(svg.Architecture(coding("vgg"), latent_size=10), 3, 2, beta=0.01),
        2,
        22_762_411,
        numbers(
            """0.992457 0.712051 0.335067 0.406755 0.958765 0.097718 0.826201 0.947865 0.695928 0.998709 0.096454 0.170141 0.993625 0.226507 0.915735 0.026295 0.999398 0.961298 0.997037 0.999129 0.994976 0.89807 0.064418 0.985496"""
        ),
        {"total": 1.041114, "error": 0.9903523, "nats": 5.07619},
    ),
    "svg-dcgan": Case(
        svg.SvgTraining(
            svg.Architecture(coding("dcgan", colours=1), latent_size=10), 3, 2, beta=0.01
        ),
        2,
        12_614_057,
        numbers(
            """0.933389 0.489589 0.936346 0.226719 0.054817 0.31128 0.95424 0.977089 0.897263 0.052065 0.994161 0.921928 0.637022 0.08337 0.802043 0.980378 0.268086 0.511701 0.973653 0.905242 0.560244 0.02476 0.991606 0.051343"""
        ),
        {"total": 1.133792, "error": 1.088374, "nats": 4.541707},
    ),
    "svg-vgg-128": Case(
        svg.SvgTraining(svg.Architecture(coding("vgg", 128), latent_size=10), 3, 2, beta=0.01),
        1,
        39_286_699,
        numbers(
            """0.745378 0.904709 0.981712 0.976294 0.889564 0.982372 0.947165 0.229294 0.520041 0.998654 0.893907 0.999699 0.987277 0.848583 0.596353 0.991532 0.751409 0.175953 0.997539 0.983746 0.201479 0.740127 0.938341 0.892194"""
        ),
        {},
    ),
    # module/srvp.py and conv.py; train() of train.py, generation of test.py
    "srvp-vgg": Case(
        SRVP(
            srvp.Architecture(
                coding("vgg"),
                True,
                state_size=50,
                latent_size=50,
                first_frames=3,
                steps_per_frame=2,
            ),
        ),
        2,
        23_880_158,
        numbers(
            """0.518633 0.46969 0.527079 0.604952 0.487418 0.488232 0.576971 0.534323 0.512686 0.534404 0.550323 0.554225 0.538974 0.511192 0.52394 0.508004 0.486105 0.538231 0.545666 0.547807 0.47428 0.545529 0.531315 0.541483"""
        ),
        {
            "total": 160591.3,
            "error": 160546.3,
            "first_nats": 6.315663,
            "nats": 16.94905,
            "residual": 5.292089,
        },
    ),
    "srvp-dcgan-without-skips": Case(
        SRVP(
            srvp.Architecture(
                coding("dcgan", colours=1),
                False,
                state_size=20,
                latent_size=20,
                first_frames=5,
                steps_per_frame=1,
            ),
        ),
        2,
        10_678_284,
        numbers(
            """0.427884 0.476947 0.486822 0.515432 0.463469 0.461082 0.48825 0.504854 0.483024 0.476719 0.451173 0.483839 0.484361 0.476757 0.490619 0.484074 0.430871 0.44689 0.448155 0.44658 0.533228 0.494891 0.531204 0.45852"""
        ),
        {
            "total": 49051.54,
            "error": 49031.23,
            "first_nats": 2.869015,
            "nats": 6.420647,
            "residual": 4.023348,
        },
    ),
    "srvp-dcgan": Case(
        SRVP(
            srvp.Architecture(
                coding("dcgan"),
                True,
                state_size=20,
                latent_size=10,
                first_frames=3,
                steps_per_frame=2,
            ),
        ),
        2,
        13_351_908,
        numbers(
            """0.447438 0.401835 0.344121 0.491509 0.490142 0.412385 0.480899 0.661544 0.563195 0.450227 0.511122 0.376645 0.46183 0.490694 0.633404 0.572251 0.544353 0.529674 0.506473 0.438594 0.432066 0.329707 0.459671 0.461858"""
        ),
        {
            "total": 106138.1,
            "error": 106124.7,
            "first_nats": 2.775476,
            "nats": 2.902813,
            "residual": 4.153242,
        },
    ),
    # models/vgg_64.py, dcgan_64.py and mask_predictor.py; train_step and eval_step of helpers.py
    "slamp-vgg": Case(
        slamp.SlampTraining(slamp.Architecture(coding("vgg"), latent_size=10), 3, 2, beta=0.01),
        2,
        45_631_126,
        numbers(
            """0.696036 0.808814 0.920063 0.547329 0.819149 0.804818 0.358207 0.419776 0.527545 0.689157 0.872846 0.568769 0.804028 0.931257 0.36956 0.866743 0.903463 0.713602 0.859661 0.924541 0.912728 0.48608 0.824216 0.485954"""
        ),
        {
            "total": 2.286616,
            "error": 0.5631136,
            "appearance": 1.016781,
            "motion": 0.5938241,
            "nats": 11.28972,
        },
    ),
    "slamp-dcgan": Case(
        slamp.SlampTraining(
            slamp.Architecture(coding("dcgan", colours=1), latent_size=10), 3, 2, beta=0.01
        ),
        2,
        25_340_948,
        numbers(
            """0.181444 0.000646 0.230587 0.634371 0.466486 0.052341 0.248352 0.181186 0.194578 0.206754 0.186155 0.209457 0.393532 0.239168 0.379986 0.592737 0.544439 0.290845 0.235167 0.409576 0.394163 0.203637 0.249639 0.211036"""
        ),
        {
            "total": 2.441594,
            "error": 0.6291428,
            "appearance": 1.117994,
            "motion": 0.5846248,
            "nats": 10.98329,
        },
    ),
    # models/kitti_models.py, cityscapes_models.py and conv_lstms.py, without the embeddings of its
    # Gaussian networks, which are never used (590,848 parameters)
    "slamp-kitti": Case(
        slamp.SlampTraining(
            slamp.Architecture(coding("vgg", code_size=64), latent_size=32, form="kitti"),
            2,
            2,
            beta=0.01,
        ),
        2,
        49_630_534,
        numbers(
            """0.919658 0.52287 0.519348 0.827165 0.790697 0.930879 0.940858 0.843288 0.926027 0.240714 0.89542 0.930975 0.1723 0.879318 0.914713 0.855151 0.028846 0.854334 0.119487 0.294205 0.000362 0.795206 0.936376 0.792535"""
        ),
        {
            "total": 1.804053,
            "error": 0.4111775,
            "appearance": 0.7420636,
            "motion": 0.4121744,
            "nats": 23.86377,
        },
    ),
    "slamp-cityscapes": Case(
        slamp.SlampTraining(
            slamp.Architecture(coding("vgg", code_size=64), latent_size=32, form="cityscapes"),
            2,
            1,
            beta=0.01,
        ),
        1,
        49_630_534,
        numbers(
            """0.795659 0.338569 0.845535 0.004589 0.817046 0.124869 0.737379 0.751243 0.902941 0.31659 0.843432 0.314262 0.120551 0.858532 0.870166 0.274445 0.000031 0.122331 0.77878 0.243762 0.00006 0.796463 0.741111 0.771732"""
        ),
        {},
    ),
}
# Scheduled sampling that never feeds the real frame back: sc_prob = 0
CASES["slamp-fed-back"] = dataclasses.replace(
    CASES["slamp-dcgan"],
    method=dataclasses.replace(CASES["slamp-dcgan"].method, sampling_constant=1e-3),
    losses={
        "total": 2.458716,
        "error": 0.640045,
        "appearance": 1.11881,
        "motion": 0.5870998,
        "nats": 11.27609,
    },
    step=10**6,
)


def seeded(case: Case) -> nn.Module:
    network = case.method.build()["video"]
    if isinstance(case.method, srvp.SrvpTraining):
        seed_weights(network, variance=0.5)
    else:
        for module in network.children():
            seed_weights(module)
    return network


def images_of(case: Case) -> Tensor:
    """Clips [B, T, C, H, W]; the authors' time comes first."""
    method = case.method
    size_px, colours = method.architecture.size_px, method.architecture.coding.colours
    num_frames = method.num_past + method.num_future
    return random_images(num_frames, case.num_clips, colours, *size_px).transpose(0, 1)


@pytest.mark.parametrize("name", CASES)
def test_predictions_are_those_of_the_authors_code(name: str) -> None:
    case = CASES[name]
    network, images = seeded(case).eval(), images_of(case)
    assert sum(parameter.numel() for parameter in network.parameters()) == case.parameters
    noise = torch.full((*images.shape[:2], network.noise_size), HALF)
    with torch.no_grad():
        predicted = network.predict(images[:, : case.method.num_past], noise)
    assert digest(predicted) == pytest.approx(case.prediction, abs=TOLERANCE)


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.losses])
def test_losses_are_those_of_the_authors_code(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """In training SRVP's skips come from a random frame, here the second, and its content from
    random frames, here the last ones.
    """
    monkeypatch.setattr(torch, "randint", lambda _, size: torch.ones(size, dtype=torch.long))
    monkeypatch.setattr(torch, "randperm", lambda count: torch.arange(count).flip(0))
    case = CASES[name]
    network = seeded(case).train()
    with torch.no_grad(), half_a_deviation():
        losses = case.method.losses(network, images_of(case), case.step)
    assert {term: float(loss) for term, loss in losses.items()} == pytest.approx(
        case.losses, rel=TOLERANCE
    )
