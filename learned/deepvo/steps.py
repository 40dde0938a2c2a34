"""Steps as rigid motions, chained to absolute poses, and squared errors between poses (thesis, eq. 3.4 to 3.6)."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

Head = Literal["2d", "3d"]


def motions(steps: Tensor, head: Head) -> Tensor:
    """Rigid motions [..., 4, 4] of steps [..., D]: the next camera's pose in this one's frame.

    Angles turn about y (yaw, to the right), then x (pitch), then z (roll), each about the axis already turned.
    """
    if head == "2d":
        x, z, yaw = steps.unbind(-1)
        y, pitch, roll = torch.zeros_like(x), torch.zeros_like(x), torch.zeros_like(x)
    else:
        x, y, z, yaw, pitch, roll = steps.unbind(-1)
    (sy, cy), (sp, cp), (sr, cr) = ((torch.sin(angle), torch.cos(angle)) for angle in (yaw, pitch, roll))
    zero, one = torch.zeros_like(x), torch.ones_like(x)
    rows = [
        *(cy * cr + sy * sp * sr, -cy * sr + sy * sp * cr, sy * cp, x),
        *(cp * sr, cp * cr, -sp, y),
        *(-sy * cr + cy * sp * sr, sy * sr + cy * sp * cr, cy * cp, z),
        *(zero, zero, zero, one),
    ]
    return torch.stack(rows, dim=-1).unflatten(-1, (4, 4))


def coordinates(first_from_cam: Tensor, head: Head) -> tuple[Tensor, Tensor]:
    """Translation [..., 2 or 3] and angles [..., 1 or 3] of motions [..., 4, 4]; the inverse of `motions`.

    In 2D they are those on the first camera's own x-z plane.
    """
    yaw = torch.atan2(first_from_cam[..., 0, 2], first_from_cam[..., 2, 2])
    if head == "2d":
        return first_from_cam[..., (0, 2), 3], yaw[..., None]
    pitch = torch.asin((-first_from_cam[..., 1, 2]).clamp(-1 + 1e-6, 1 - 1e-6))
    roll = torch.atan2(first_from_cam[..., 1, 0], first_from_cam[..., 1, 1])
    return first_from_cam[..., :3, 3], torch.stack([yaw, pitch, roll], dim=-1)


def chained(relative: Tensor) -> Tensor:
    """Poses [..., N, 4, 4] in the first camera's frame, of motions from each camera to the next (eq. 3.4)."""
    poses = [relative[..., 0, :, :]]
    for index in range(1, relative.shape[-3]):
        poses.append(poses[-1] @ relative[..., index, :, :])
    return torch.stack(poses, dim=-3)


def squared_errors(predicted: Tensor, real: Tensor, head: Head) -> tuple[Tensor, Tensor]:
    """Squared translation (m^2) and squared rotation (rad^2) [...] between poses [..., 4, 4]: the terms of eq. 3.6."""
    (moved, turned), (really_moved, really_turned) = coordinates(predicted, head), coordinates(real, head)
    angle = turned - really_turned
    wrapped = torch.atan2(torch.sin(angle), torch.cos(angle))
    return ((moved - really_moved) ** 2).sum(-1), (wrapped**2).sum(-1)
