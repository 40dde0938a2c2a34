import numpy as np
import pytest
import torch
from torch import Tensor

from geovp_learned.synsin import splatting
from geovp_learned.synsin.splatting import Splatter

SIZE_PX, NEAR_M = (9, 11), 0.5
CAMERA = torch.tensor([[12.0, 10.0, 5.0, 4.0]], dtype=torch.float64)  # fx, fy, cx, cy


def random_points() -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Positions, inverse depths, visibility and three features of points around a small image, one
    batch of two.
    """
    rng, count = np.random.default_rng(1), 60
    positions = torch.from_numpy(rng.uniform([-2, -2], [12, 10], (2, count, 2)))
    depths = torch.from_numpy(rng.uniform(0.01, 1, (2, count)))
    visible = torch.from_numpy(rng.random((2, count)) < 0.8)
    return positions, depths, visible, torch.from_numpy(rng.uniform(0, 1, (2, count, 3)))


def splatted_naively(
    splatter: Splatter, positions: Tensor, depths: Tensor, visible: Tensor, features: Tensor
) -> tuple[Tensor, Tensor]:
    """The splatter's definition, pixel by pixel and point by point."""
    image = torch.zeros(len(positions), features.shape[2], *SIZE_PX, dtype=features.dtype)
    opacity = torch.zeros(len(positions), 1, *SIZE_PX, dtype=features.dtype)
    for b in range(len(positions)):
        for v in range(SIZE_PX[0]):
            for u in range(SIZE_PX[1]):
                found = []
                for n in range(positions.shape[1]):
                    distance = float(torch.hypot(positions[b, n, 0] - u, positions[b, n, 1] - v))
                    if visible[b, n] and distance < splatter.radius_px:
                        found.append((float(-depths[b, n]), n, distance / splatter.radius_px))
                light, weights = 1.0, []
                for _, n, share in sorted(found)[: splatter.points_per_pixel]:
                    alpha = max(1 - max(share, 1e-3), 0)
                    weights.append((n, alpha * light))
                    light *= 1 - alpha
                for n, weight in weights:
                    image[b, :, v, u] += weight * features[b, n]
                    opacity[b, 0, v, u] += weight
    return image, opacity


@pytest.mark.parametrize(("radius_px", "points_per_pixel"), [(1.5, 3), (0.7, 8), (2.6, 64)])
def test_splatter_is_equal_to_loops_over_pixels_and_points(
    radius_px: float, points_per_pixel: int
) -> None:
    splatter = Splatter(radius_px, points_per_pixel, 1e-3)
    points = random_points()
    image, opacity = splatter(*points, SIZE_PX)
    wanted, wanted_opacity = splatted_naively(splatter, *points)
    assert (wanted_opacity > 0).sum() > 50  # there is something to compare
    torch.testing.assert_close(image, wanted, rtol=0, atol=1e-10)
    torch.testing.assert_close(opacity, wanted_opacity, rtol=0, atol=1e-10)


def test_gradients_are_those_of_finite_differences_and_go_through_the_camera() -> None:
    rays = splatting.rays(CAMERA, SIZE_PX)
    motion = torch.eye(4, dtype=torch.float64)[None].clone()
    motion[0, :3, 3] = torch.tensor([0.3, -0.1, -1.0])
    features = torch.rand(
        1, rays.shape[1], 2, dtype=torch.float64, generator=torch.Generator().manual_seed(0)
    ).requires_grad_()
    depths = torch.linspace(0.02, 0.2, rays.shape[1], dtype=torch.float64)[None].requires_grad_()

    def images(inverse_depths: Tensor, coloured: Tensor) -> tuple[Tensor, Tensor]:
        positions, _, in_front = splatting.project(rays, inverse_depths, motion, CAMERA, NEAR_M)
        # depth order is held fixed: where two points swap, the image jumps and has no slope
        return Splatter(1.5, 4, 1e-3)(positions, depths.detach(), in_front, coloured, SIZE_PX)

    assert torch.autograd.gradcheck(images, (depths, features), eps=1e-7, atol=1e-3, rtol=1e-3)


def test_points_behind_the_camera_or_too_near_are_not_in_front() -> None:
    motion = torch.eye(4, dtype=torch.float64)[None].clone()
    motion[0, 2, 3] = -4.0
    ray = torch.tensor([[[0.0, 0.0, 1.0]] * 3], dtype=torch.float64)
    depths = 1 / torch.tensor([[3.0, 4.0 + 0.9 * NEAR_M, 4.0 + 1.1 * NEAR_M]])
    _, _, in_front = splatting.project(ray, depths, motion, CAMERA, NEAR_M)
    assert in_front[0].tolist() == [False, False, True]
