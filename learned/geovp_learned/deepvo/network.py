"""DeepVO's networks: a FlowNetS encoder of image pairs, an LSTM over the pairs, and a decoder of
future motion.

Wang et al. 2017 (DeepVO), with a decoder LSTM that starts from the last hidden state and is fed
zeros (eq. 3.2 and 3.3 of the thesis). A step is the pose of the next camera in this one's frame, in
metres and radians: (x, z, yaw) or (x, y, z, yaw, pitch, roll).
"""

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor, nn

from geovp_classic.types import Intrinsics

Head = Literal["2d", "3d"]

FLOWNET = (  # channels, kernel size and stride of each convolution
    (64, 7, 2),
    (128, 5, 2),
    (256, 5, 2),
    (256, 3, 1),
    (512, 3, 2),
    (512, 3, 1),
    (512, 3, 2),
    (512, 3, 1),
    (1024, 3, 2),
)
STEP_SCALES = (0.1, 0.1, 1.0, 0.02, 0.02, 0.02)  # of x, y, z, yaw, pitch, roll; a car at 10 Hz
AXES = {"2d": (0, 2, 3), "3d": (0, 1, 2, 3, 4, 5)}  # of these, in a step
PAIRS_AT_ONCE = 256  # through the encoder, so that long videos fit into memory


@dataclass(frozen=True)
class Architecture:
    """Sizes of the networks; stored with the weights.

    Frames are reprojected to the network's own camera first, so that images of other cameras look
    alike.
    """

    size_px: tuple[int, int] = (256, 256)
    focal_widths: float = 1.93  # of the network's camera; KITTI's central square has 1.91 to 1.93
    centre: tuple[float, float] = (0.468, 0.475)  # its principal point, in widths and heights
    encoder_width: float = 1.0  # channels, as a fraction of FlowNetS's
    dropout: float = 0.2  # after the last convolution, and between layers of the LSTM
    lstm_size: int = 50
    lstm_layers: int = 1
    head: Head = "2d"
    decoder_start: Literal["hidden-state", "poses"] = "hidden-state"

    @property
    def camera(self) -> Intrinsics:
        """Return the camera that the network was trained for."""
        width_px, height_px = self.size_px
        focal_px = self.focal_widths * width_px
        cx_px, cy_px = self.centre[0] * width_px - 0.5, self.centre[1] * height_px - 0.5
        return Intrinsics(focal_px, focal_px, cx_px, cy_px, width_px, height_px)


class PoseNetwork(nn.Module):
    """From images to the steps between them and after them."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.architecture = architecture
        size, layers, drop = architecture.lstm_size, architecture.lstm_layers, architecture.dropout
        self.encoder = encoder(architecture.encoder_width, drop)
        with torch.no_grad():
            width_px, height_px = architecture.size_px
            features = self.encoder.eval()(torch.zeros(1, 6, height_px, width_px)).numel()
        self.past = nn.LSTM(
            features, size, layers, batch_first=True, dropout=drop if layers > 1 else 0.0
        )
        self.past_head = StepHead(size, architecture.head)
        self.future = Decoder(architecture)
        self.train()

    def forward(self, images: Tensor, num_future: int) -> tuple[Tensor, Tensor]:
        """Estimate steps [B, P - 1, D] within images [B, P, 3, H, W] in [0, 1] and [B, F, D] after
        them; P >= 2.
        """
        hidden, state = self.past(self.encode(images))
        past = self.past_head(hidden)
        return past, self.future(state, past, num_future)

    def encode(self, images: Tensor) -> Tensor:
        """Encode consecutive pairs, stacked in their channels, as features [B, P - 1, N]."""
        pairs = torch.cat([images[:, :-1], images[:, 1:]], dim=2) - 0.5
        batch, count = pairs.shape[:2]
        flat = pairs.flatten(0, 1).contiguous(memory_format=torch.channels_last)
        parts = [flat] if self.training else flat.split(PAIRS_AT_ONCE)
        return torch.cat([self.encoder(chunk) for chunk in parts]).unflatten(0, (batch, count))


class Decoder(nn.Module):
    """An LSTM that is fed zeros, so its output depends on its first state alone (eq. 3.3)."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        size, layers = architecture.lstm_size, architecture.lstm_layers
        self.from_poses: nn.LSTM | None = None
        if architecture.decoder_start == "poses":
            self.from_poses = nn.LSTM(len(AXES[architecture.head]), size, layers, batch_first=True)
        self.lstm = nn.LSTM(1, size, layers, batch_first=True)
        self.head = StepHead(size, architecture.head)

    def forward(self, state: tuple[Tensor, Tensor], past: Tensor, num_future: int) -> Tensor:
        """Predict steps [B, F, D] from the encoder's state, or from the past steps [B, P - 1, D]
        alone.
        """
        if self.from_poses is not None:
            _, state = self.from_poses(past / self.head.scale)
        hidden, _ = self.lstm(past.new_zeros(len(past), num_future, 1), state)
        return self.head(hidden)


class StepHead(nn.Module):
    """Hidden states to steps, scaled so that an untrained network predicts motions of
    a car's size.
    """

    scale: Tensor

    def __init__(self, size: int, head: Head) -> None:
        super().__init__()
        scale = torch.tensor([STEP_SCALES[axis] for axis in AXES[head]])
        self.register_buffer("scale", scale, persistent=False)
        self.linear = nn.Linear(size, len(scale))

    def forward(self, hidden: Tensor) -> Tensor:
        """Map hidden states [..., N] to steps [..., D]."""
        return self.linear(hidden) * self.scale


def encoder(width: float, dropout: float) -> nn.Sequential:
    """Build the contracting part of FlowNetS (Dosovitskiy et al. 2015) with batch norm, `width`
    times its channels, flattened.
    """
    layers: list[nn.Module] = []
    in_channels = 6
    for channels, kernel, stride in FLOWNET:
        out_channels = max(1, round(channels * width))
        convolution = nn.Conv2d(in_channels, out_channels, kernel, stride, kernel // 2, bias=False)
        layers += [convolution, nn.BatchNorm2d(out_channels), nn.LeakyReLU(0.1)]
        in_channels = out_channels
    layers += [nn.Flatten(), nn.Dropout(dropout)]
    encoder = nn.Sequential(*layers)
    return encoder.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


def motions(steps: Tensor, head: Head) -> Tensor:
    """Convert steps [..., D] to rigid motions [..., 4, 4]: the next camera's pose in this one's
    frame.

    Angles turn about y (yaw, to the right), then x (pitch), then z (roll), each about the axis
    already turned.
    """
    numbers = steps.new_zeros(*steps.shape[:-1], 6)
    numbers[..., AXES[head]] = steps
    halves = steps.new_zeros(3, 4, 4)
    halves[(0, 1, 2), (0, 2, 1), (2, 1, 0)] = 1.0
    generators = halves - halves.mT  # of rotations about y, x and z
    rotations = torch.matrix_exp(numbers[..., 3:, None, None] * generators)
    yawed, pitched, rolled = rotations.unbind(-3)
    motion = yawed @ pitched @ rolled
    motion[..., :3, 3] = numbers[..., :3]
    return motion


def coordinates(first_from_cam: Tensor, head: Head) -> Tensor:
    """Return the steps [..., D] of motions [..., 4, 4]; the inverse of `motions`.

    In 2D they are those on the first camera's own x-z plane.
    """
    yaw = torch.atan2(first_from_cam[..., 0, 2], first_from_cam[..., 2, 2])
    pitch = torch.asin((-first_from_cam[..., 1, 2]).clamp(-1 + 1e-6, 1 - 1e-6))
    roll = torch.atan2(first_from_cam[..., 1, 0], first_from_cam[..., 1, 1])
    angles = torch.stack([yaw, pitch, roll], dim=-1)
    return torch.cat([first_from_cam[..., :3, 3], angles], dim=-1)[..., AXES[head]]


def chained(relative: Tensor) -> Tensor:
    """Chain motions from each camera to the next to poses [..., N, 4, 4] in the first camera's
    frame (eq. 3.4).
    """
    poses = [relative[..., 0, :, :]]
    for index in range(1, relative.shape[-3]):
        poses.append(poses[-1] @ relative[..., index, :, :])
    return torch.stack(poses, dim=-3)


def squared_errors(predicted: Tensor, real: Tensor, head: Head) -> tuple[Tensor, Tensor]:
    """Return squared translation (m^2) and squared rotation (rad^2) [...] between poses [..., 4,
    4]: the terms of eq. 3.6.
    """
    difference = coordinates(predicted, head) - coordinates(real, head)
    num_lengths = AXES[head].index(3)
    angles = difference[..., num_lengths:]
    wrapped = torch.atan2(torch.sin(angles), torch.cos(angles))
    return (difference[..., :num_lengths] ** 2).sum(-1), (wrapped**2).sum(-1)
