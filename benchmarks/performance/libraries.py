"""Our solvers, next to those of pycolmap for the same problems.

Random points are observed by known cameras, with noise and, as in the odometry, with outliers. A
solver of our own stays only where it is three times as fast or more accurate.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from geovp_classic.colmap_library import pycolmap
from geovp_classic.geometry import se3
from geovp_classic.geometry.two_view import homogeneous, refine
from geovp_classic.odometry.resection import Resection
from geovp_classic.odometry.triangulation import triangulate
from geovp_classic.types import FloatArray
from performance import Comparison


@dataclass(frozen=True)
class Scene:
    """Points observed by a camera that drives forward."""

    points: FloatArray  # [N, 3]
    cam_from_world: FloatArray  # [V, 4, 4]
    rays: FloatArray  # [V, N, 2], with noise
    noise: float  # of a ray's coordinates
    with_outliers: FloatArray  # [N, 2], the last view's rays, some of them far off

    @classmethod
    def random(cls) -> Self:
        """Draw points within a street's width, 6 to 60 m ahead; 45 of 300 are outliers."""
        rng = np.random.default_rng(0)
        points = rng.uniform((-12, -4, 6), (12, 1.6, 60), (300, 3))
        poses = se3.exp(np.outer(np.arange(8), [0.02, 0, -0.7, 0, 0.01, 0]))
        in_camera = se3.transform(poses, points)
        noise = 0.25 / 700.0  # a quarter of a pixel, at the focal length of KITTI
        rays = in_camera[..., :2] / in_camera[..., 2:]
        rays += rng.normal(0, noise, rays.shape)
        with_outliers = rays[-1].copy()
        with_outliers[:45] += rng.uniform(-0.1, 0.1, (45, 2))
        return cls(points, poses, rays, noise, with_outliers)


def problems() -> list[Comparison]:
    """Return all problems on one scene."""
    scene = Scene.random()
    return [triangulation(scene), resection(scene), relative_pose(scene)]


def triangulation(scene: Scene) -> Comparison:
    """Return the triangulation of all points from all views."""
    poses = list(scene.cam_from_world[:, :3])

    def rival() -> list[Any]:
        rays = np.moveaxis(directions(scene.rays), 1, 0)
        return [pycolmap.triangulate_multi_view_point(poses, each) for each in rays]

    def error(points: Any) -> float:
        distances = np.linalg.norm(np.reshape(points, (-1, 3)) - scene.points, axis=1)
        return float(np.median(distances))

    return Comparison(
        "triangulation",
        lambda: triangulate(scene.rays, scene.cam_from_world),
        "pycolmap",
        rival,
        error,
        "m",
    )


def resection(scene: Scene) -> Comparison:
    """Return the search of the last view's pose by known points, from half a metre off."""
    truth = scene.cam_from_world[-1]
    guess = se3.exp(np.array([0, 0, 0.5, 0, 0.01, 0])) @ truth
    camera = pycolmap.Camera(model="PINHOLE", width=2, height=2, params=[1.0, 1.0, 0.0, 0.0])
    options = pycolmap.AbsolutePoseRefinementOptions(
        loss_function_scale=scene.noise, gradient_tolerance=1e-9
    )
    is_used = np.ones(len(scene.points), dtype=bool)
    arguments = (scene.with_outliers, scene.points, is_used, camera, options)

    def rival() -> FloatArray:
        solution: Any = pycolmap.refine_absolute_pose(pycolmap.Rigid3d(guess[:3]), *arguments)
        return matrix_of(solution["cam_from_world"])

    return Comparison(
        "resection",
        lambda: Resection().refine(scene.points, scene.with_outliers, guess, scene.noise),
        "pycolmap",
        rival,
        lambda pose: float(np.linalg.norm((se3.inverse(pose) - se3.inverse(truth))[:3, 3])),
        "m",
    )


def relative_pose(scene: Scene) -> Comparison:
    """Return the search of the motion between the first and last view, one or two degrees off."""
    truth = scene.cam_from_world[-1].copy()
    truth[:3, 3] /= np.linalg.norm(truth[:3, 3])
    guess = se3.exp(np.array([0.03, -0.02, 0, 0.002, -0.001, 0.001])) @ truth
    guess[:3, 3] /= np.linalg.norm(guess[:3, 3])
    rays = (scene.rays[0], scene.with_outliers)
    before, after = map(directions, rays)
    is_used = np.ones(len(before), dtype=bool)

    def rival() -> FloatArray:
        solution: Any = pycolmap.refine_relative_pose(
            pycolmap.Rigid3d(guess[:3]), before, after, is_used
        )
        return matrix_of(solution["cam2_from_cam1"])

    def error(pose: FloatArray) -> float:
        return float(np.degrees(np.arccos(np.clip(pose[:3, 3] @ truth[:3, 3], -1, 1))))

    return Comparison(
        "relative pose",
        lambda: refine(*rays, guess, scene.noise),
        "pycolmap",
        rival,
        error,
        "deg",
    )


def directions(rays: FloatArray) -> FloatArray:
    """Return unit vectors [..., 3] of rays [..., 2]."""
    directions = homogeneous(rays)
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def matrix_of(pose: pycolmap.Rigid3d) -> FloatArray:
    """Return a transform [4, 4] in pycolmap's form as a matrix."""
    matrix = np.asarray(pose.matrix())
    return se3.compose(matrix[:, :3], matrix[:, 3])
