"""A street of flat ground, a wall ahead and a box in front of it, with or without a moving car."""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.ground_plane import GroundPlane
from geovp_classic.types import BoolArray, Context, FloatArray, Intrinsics, Trajectory

CAMERA = Intrinsics(120.0, 120.0, 63.5, 55.0, 128, 112)
HEIGHT = 1.6  # of the camera above the ground
WALL = 24.0  # z of the wall, in world coordinates
BOX = (1.0, 4.0, 14.0)  # left and right x of a box's front that stands on the ground, and its z


def _texture(points: FloatArray, tint: float) -> FloatArray:
    """Grey values [...] 0..255 of points [..., 3]: waves of several directions, none shorter than
    0.4.
    """
    rng = np.random.default_rng(7)
    value = np.full(points.shape[:-1], 128.0)
    for wavelength in (0.4, 0.55, 0.8, 1.3, 2.5, 5.0):
        for _ in range(3):
            direction = rng.normal(size=3)
            phase = points @ (2 * np.pi / wavelength * direction / np.linalg.norm(direction))
            value = value + 14 * np.sin(phase + tint + rng.uniform(0, 6))
    return value


def depth_of_street(
    world_from_cam: FloatArray, camera: Intrinsics = CAMERA
) -> tuple[FloatArray, FloatArray]:
    """The z-depth [H, W] that a camera sees, and the points [H, W, 3] in the world."""
    rays = pinhole.rays(camera) @ world_from_cam[:3, :3].T
    origin = world_from_cam[:3, 3]
    with np.errstate(divide="ignore"):
        ground = np.where(rays[..., 1] > 1e-9, (HEIGHT - origin[1]) / rays[..., 1], np.inf)
        wall = (WALL - origin[2]) / rays[..., 2]
        box = (BOX[2] - origin[2]) / rays[..., 2]
    on_box = origin + box[..., None] * rays
    hit = (
        (on_box[..., 0] > BOX[0])
        & (on_box[..., 0] < BOX[1])
        & (on_box[..., 1] > HEIGHT - 3.0)
        & (box > 0)
    )
    depth = np.minimum(
        np.minimum(ground, wall), np.where(hit & (on_box[..., 1] < HEIGHT), box, np.inf)
    )
    return depth, origin + depth[..., None] * rays


def image_of_street(world_from_cam: FloatArray, camera: Intrinsics = CAMERA) -> FloatArray:
    """What the camera sees, uint8 [H, W, 3]; each pixel is sampled four times, so that nothing
    flickers.
    """
    fine = camera.resized(2 * camera.width_px, 2 * camera.height_px)
    _, points = depth_of_street(world_from_cam, fine)
    value = _texture(points, 0.0)
    value = value.reshape(camera.height_px, 2, camera.width_px, 2).mean(axis=(1, 3))
    return np.repeat(np.clip(np.round(value), 0, 255).astype(np.uint8)[..., None], 3, axis=-1)


@pytest.fixture(scope="session")
def observe() -> Callable[..., tuple[Context, Trajectory, FloatArray]]:
    """Context, past trajectory and true inverse depths [P, H, W] of a street seen from the given
    poses.
    """

    def _observe(
        world_from_cam: FloatArray, unit_m: float = 1.0
    ) -> tuple[Context, Trajectory, FloatArray]:
        num = len(world_from_cam)
        frames = np.stack([image_of_street(one) for one in world_from_cam])
        times_s = 0.1 * np.arange(num + 1)
        in_unit = np.array(world_from_cam)
        in_unit[:, :3, 3] /= unit_m
        truth = np.stack([unit_m / depth_of_street(one)[0] for one in world_from_cam])
        return (
            Context(frames, times_s, CAMERA),
            Trajectory(in_unit, times_s[:num], unit_m == 1.0),
            truth,
        )

    return _observe


@pytest.fixture(scope="session")
def image() -> Callable[..., FloatArray]:
    """What a camera at a pose sees of the street."""
    return image_of_street


@dataclass(frozen=True)
class Car:
    """A car's flat back that stands on the ground at time 0 and moves along it."""

    left: float = -2.2  # x
    right: float = -0.4
    height: float = 1.5
    distance: float = 8.0  # z
    velocity: tuple[float, float, float] = (1.2, 0.0, 5.0)  # per second

    def image(self, world_from_cam: FloatArray, seconds: float) -> tuple[FloatArray, BoolArray]:
        """Street and car, float32 grey [H, W], and where the car is [H, W]; each pixel is sampled
        four times.
        """
        fine = CAMERA.resized(2 * CAMERA.width_px, 2 * CAMERA.height_px)
        origin = world_from_cam[:3, 3] - seconds * np.array(self.velocity)  # in the car's own frame
        rays = pinhole.rays(fine) @ world_from_cam[:3, :3].T
        points = origin + ((self.distance - origin[2]) / rays[..., 2])[..., None] * rays
        hit = (points[..., 0] > self.left) & (points[..., 0] < self.right)
        hit &= (points[..., 1] < HEIGHT) & (points[..., 1] > HEIGHT - self.height)
        street = _texture(
            0.4 * depth_of_street(world_from_cam, fine)[1], 0.0
        )  # coarser than a pixel at the wall
        grey = np.where(hit, _texture(0.7 * points, 2.0), street)
        blocks = (
            one.reshape(CAMERA.height_px, 2, CAMERA.width_px, 2).mean(axis=(1, 3))
            for one in (grey, hit)
        )
        value, share = blocks
        return np.clip(np.round(value), 0, 255).astype(np.float32), share > 0.5


@dataclass(frozen=True)
class Traffic:
    """Ten images of the street with a car that drives on it, and what is true of the last one."""

    images: FloatArray  # [10, H, W] float32 grey
    past: Trajectory  # [10], the last pose is the identity
    camera: Intrinsics
    inverse_depth: FloatArray  # [H, W] of the street alone
    mask: BoolArray  # [H, W], the car
    road: GroundPlane


@pytest.fixture(scope="session")
def drive_behind() -> Callable[..., Traffic]:
    """A camera that drives at 4 m/s behind a car, or towards it."""

    @functools.cache
    def _drive(
        velocity: tuple[float, float, float] = Car.velocity,
        unit_m: float = 1.0,
        distance: float = Car.distance,
    ) -> Traffic:
        car, times_s = Car(velocity=velocity, distance=distance), 0.1 * np.arange(-9, 1)
        poses = se3.exp(np.outer(times_s, [0, 0, 4.0, 0, 0, 0]))
        images, masks = zip(
            *(car.image(pose, t) for pose, t in zip(poses, times_s, strict=True)), strict=True
        )
        poses[:, :3, 3] /= unit_m
        street = (unit_m / depth_of_street(np.eye(4))[0]).astype(np.float32)
        road = GroundPlane(np.array([0.0, 1.0, 0.0]), HEIGHT / unit_m)
        return Traffic(
            np.stack(images),
            Trajectory(poses, times_s, unit_m == 1.0),
            CAMERA,
            street,
            masks[-1],
            road,
        )

    return _drive
