"""How fast SynSin's splatter is, beside the dense way, which compares every pixel with every point.

`python -m benchmarks.performance.splatting_torch [SIDE_PX] [DEVICE]`: SIDE_PX x SIDE_PX points, 256 by default, of a
road and two walls, three metres ahead of where they were seen, onto as many pixels. The dense way takes a strip of
pixels at a time, or it would not fit into memory; it is timed on some strips and counted up to all of them.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from benchmarks.commands import command, whole_numbers
from geovp_classic.errors import BadData
from learned.synsin import splatting
from learned.synsin.splatting import Splatter

CHANNELS = 16
AHEAD_M = 3.0
STRIP_PX = 256  # pixels that the dense way takes at once
STRIPS = 8  # of them are timed
REPEATS = 5

Points = tuple[Tensor, Tensor, Tensor, Tensor]


@dataclass(frozen=True)
class Timing:
    """What both ways took for one image."""

    side_px: int
    forward_s: float  # median of REPEATS
    backward_s: float
    dense_s: float  # forward alone, counted up from the timed strips
    difference: float  # largest, where both drew
    peak_mb: float  # of the process

    def lines(self) -> list[str]:
        """The result in words."""
        return [
            f"{self.side_px}x{self.side_px} points, {CHANNELS} features: forward {1e3 * self.forward_s:.0f} ms, "
            f"backward {1e3 * self.backward_s:.0f} ms; peak memory {self.peak_mb:.0f} MB",
            f"dense: forward {1e3 * self.dense_s:.0f} ms ({self.dense_s / self.forward_s:.0f} times as long); "
            f"largest difference {self.difference:.1g}",
        ]


def street(side_px: int, device: str) -> Points:
    """Positions [1, N, 2], inverse depths [1, N], visibility [1, N] and features [1, N, C] of a drawn street."""
    focal_px, middle_px = 1.9 * side_px, (side_px - 1) / 2
    camera = torch.tensor([[focal_px, focal_px, middle_px, middle_px]], device=device)
    rays = splatting.rays(camera, (side_px, side_px))
    road, walls = rays[..., 1].clamp(min=0) / 1.65, rays[..., 0].abs() / 6.0
    motion = torch.eye(4, device=device)[None].clone()
    motion[0, 2, 3] = -AHEAD_M
    random = torch.rand(1, side_px**2, CHANNELS + 1, generator=torch.Generator().manual_seed(0)).to(device)
    rough = torch.maximum(road, walls) * (1 + 0.01 * random[..., -1])  # a row of one depth would have no order
    return (*splatting.project(rays, rough, motion, camera), random[..., :-1].contiguous())


def dense(splatter: Splatter, points: Points, pixels: Tensor, side_px: int) -> Tensor:
    """Alpha-composited features [P, C] of pixels [P], from the distances of all points to all of them."""
    positions, inverse_depths, visible, features = (part[0] for part in points)
    centres = torch.stack([pixels % side_px, pixels // side_px], dim=1)
    squares = (positions[None] - centres[:, None]).square().sum(dim=2) / splatter.radius_px**2  # [P, N]
    near = torch.where((squares < 1) & visible, inverse_depths, -1.0)
    found, chosen = near.topk(splatter.points_per_pixel, dim=1)
    opacities = (1 - (squares.gather(1, chosen) + splatting.EPS).sqrt()).clamp(min=0) ** splatter.sharpness
    opacities = torch.where(found >= 0, opacities, 0.0)
    through = torch.cumprod(1 - opacities, dim=1)
    before = torch.cat([torch.ones_like(through[:, :1]), through[:, :-1]], dim=1)
    return torch.einsum("pk,pkc->pc", opacities * before, features[chosen])


def measure(side_px: int = 256, device: str = "cpu") -> Timing:
    """Time both ways on the same points."""
    splatter, points = Splatter(radius_px=1.5, points_per_pixel=8), street(side_px, device)
    positions, features = points[0].requires_grad_(), points[3].requires_grad_()
    forward_s, backward_s = [], []
    for _ in range(REPEATS):
        start = _now(device)
        image, _ = splatter(positions, points[1], points[2], features, (side_px, side_px))
        middle = _now(device)
        image.square().sum().backward()
        forward_s.append(middle - start)
        backward_s.append(_now(device) - middle)
    flat = image.detach()[0].flatten(1).T
    strips = torch.arange(side_px**2, device=device).split(STRIP_PX)
    timed = strips[:: max(len(strips) // STRIPS, 1)]
    with torch.no_grad():
        start = _now(device)
        drawn = [dense(splatter, points, strip, side_px) for strip in timed]
        dense_s = (_now(device) - start) / len(timed) * len(strips)
    difference = max(float((one - flat[strip]).abs().max()) for one, strip in zip(drawn, timed, strict=True))
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return Timing(side_px, _median(forward_s), _median(backward_s), dense_s, difference, peak_mb)


def _now(device: str) -> float:
    if device.startswith("cuda"):
        torch.cuda.synchronize()
    return time.perf_counter()


def _median(values: Sequence[float]) -> float:
    return sorted(values)[len(values) // 2]


@command
def main(arguments: Sequence[str]) -> str:
    """The timing in words."""
    (side_px,) = whole_numbers(arguments[:1], (256,), "[SIDE_PX [cpu|cuda]]")
    device = " ".join(arguments[1:]) or "cpu"
    if device not in ("cpu", "cuda") or (device == "cuda" and not torch.cuda.is_available()):
        raise BadData(f"device {device!r}: expected cpu, or cuda where there is a GPU")
    return "\n".join(measure(side_px, device).lines())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
