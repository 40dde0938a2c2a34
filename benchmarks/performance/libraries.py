"""Time and error of our solvers and of library solvers for the same problems.

`PYTHONPATH=benchmarks python -m performance.libraries [ROUNDS]`

Random points are observed by known cameras, with noise and, as in the odometry, with outliers. Both
solvers get the same problem, one after the other. Medians over rounds are of CPU time. A solver of
our own stays only where it is three times as fast or more accurate.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from geovp_classic.colmap_library import pycolmap
from geovp_classic.geometry import se3
from geovp_classic.geometry.bundle_adjustment import INVERSE_DEPTHS, Bundle, BundleAdjustment
from geovp_classic.geometry.two_view import homogeneous, refine
from geovp_classic.odometry.bundle import bundle_adjust
from geovp_classic.odometry.lens import Lens
from geovp_classic.odometry.resection import refine_pose
from geovp_classic.odometry.triangulation import triangulate
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.pose_refinement.registration import ImageRegistration
from geovp_classic.types import FloatArray, Intrinsics
from performance import rounds_parser, timed

CAMERA = Intrinsics(700.0, 700.0, 620.0, 185.0, 1241, 376)
NUM_POINTS, NUM_VIEWS, WRONG_SHARE = 300, 8, 0.15
NOISE = 0.25 / CAMERA.fx_px  # of a ray's coordinates

Solver = Callable[[], FloatArray]


@dataclass(frozen=True)
class Comparison:
    """One problem with two solvers."""

    name: str
    unit: str  # of the errors
    ours: Solver
    library: Solver
    error: Callable[[FloatArray], float]  # of a solution, against the truth


@dataclass(frozen=True)
class Scene:
    """Points observed by a camera that drives forward."""

    points: FloatArray  # [N, 3]
    cam_from_world: FloatArray  # [V, 4, 4]
    rays: FloatArray  # [V, N, 2], with noise
    wrong: FloatArray  # [N, 2], the last view's rays, some of them far off

    @classmethod
    def random(cls, seed: int = 0) -> Self:
        """A street's width, 6 to 60 m ahead."""
        rng = np.random.default_rng(seed)
        points = rng.uniform((-12, -4, 6), (12, 1.6, 60), (NUM_POINTS, 3))
        poses = se3.exp(np.arange(NUM_VIEWS)[:, None] * np.array([0.02, 0, -0.7, 0, 0.01, 0]))
        cam = se3.transform(poses, points)
        rays = cam[..., :2] / cam[..., 2:] + rng.normal(0, NOISE, (NUM_VIEWS, NUM_POINTS, 2))
        wrong, count = rays[-1].copy(), int(WRONG_SHARE * NUM_POINTS)
        wrong[:count] += rng.uniform(-0.1, 0.1, (count, 2))
        return cls(points, poses, rays, wrong)


def triangulation(scene: Scene) -> Comparison:
    """All points from all views."""
    directions = homogeneous(scene.rays)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    poses = list(scene.cam_from_world[:, :3])

    def library() -> FloatArray:
        points = [
            pycolmap.triangulate_multi_view_point(poses, directions[:, n])
            for n in range(NUM_POINTS)
        ]
        return np.reshape(np.asarray(points, dtype=np.float64), (-1, 3))

    def error(points: FloatArray) -> float:
        return float(np.median(np.linalg.norm(points - scene.points, axis=1)))

    return Comparison(
        "triangulation", "m", lambda: triangulate(scene.rays, scene.cam_from_world), library, error
    )


def resection(scene: Scene) -> Comparison:
    """The last view's pose by known points, from a guess half a metre off."""
    truth, guess = (
        scene.cam_from_world[-1],
        se3.exp(np.array([0, 0, 0.5, 0, 0.01, 0])) @ scene.cam_from_world[-1],
    )
    camera = pycolmap.Camera(model="PINHOLE", width=2, height=2, params=[1.0, 1.0, 0.0, 0.0])
    options = pycolmap.AbsolutePoseRefinementOptions(
        loss_function_scale=NOISE, gradient_tolerance=1e-9
    )
    everything = np.ones(NUM_POINTS, dtype=bool)

    def library() -> FloatArray:
        given = (_rigid(guess), scene.wrong, scene.points, everything, camera, options)
        return _matrix(pycolmap.refine_absolute_pose(*given), "cam_from_world")

    def ours() -> FloatArray:
        return refine_pose(scene.points, scene.wrong, guess, NOISE)

    return Comparison("resection", "m", ours, library, lambda pose: _distance(pose, truth))


def relative_pose(scene: Scene) -> Comparison:
    """The motion between the first and the last view, from one or two degrees off; errors of its
    direction.
    """
    truth, nearby = (
        _unit(scene.cam_from_world[-1]),
        se3.exp(np.array([0.03, -0.02, 0, 0.002, -0.001, 0.001])),
    )
    near, rays = _unit(nearby @ truth), (scene.rays[0], scene.wrong)
    a, b = (homogeneous(r) / np.linalg.norm(homogeneous(r), axis=1, keepdims=True) for r in rays)
    everything = np.ones(NUM_POINTS, dtype=bool)

    def library() -> FloatArray:
        return _matrix(
            pycolmap.refine_relative_pose(_rigid(near), a, b, everything), "cam2_from_cam1"
        )

    def error(pose: FloatArray) -> float:
        return float(np.degrees(np.arccos(np.clip(pose[:3, 3] @ truth[:3, 3], -1, 1))))

    return Comparison("relative pose", "deg", lambda: refine(*rays, near, NOISE), library, error)


def local_bundle_adjustment(scene: Scene) -> Comparison:
    """All poses, from a hundredth of a degree and some millimetres off; pycolmap's adjustment fixes
    the scale alone.
    """
    poses, rng = scene.cam_from_world, np.random.default_rng(1)
    deviations = rng.normal(0, 1, (NUM_VIEWS - 1, 6)) * ((5e-3,) * 3 + (2e-4,) * 3)
    given, pixels = (
        np.concatenate([poses[:1], se3.exp(deviations) @ poses[1:]]),
        Lens(CAMERA).pixels(scene.rays),
    )
    visible = np.ones((NUM_VIEWS - 1, NUM_POINTS), dtype=bool)
    points = np.pad(homogeneous(scene.rays[0]), ((0, 0), (0, 1)))
    bundle = Bundle(given[1:], points, pixels[1:], visible, CAMERA)
    prior = ImageRegistration().prior(given[1:])

    def ours() -> FloatArray:
        start = bundle.with_inverse_depths()
        adjusted = BundleAdjustment().adjust(start, INVERSE_DEPTHS, prior)
        last: FloatArray = adjusted.cam_from_world[-1]
        return last

    def library() -> FloatArray:
        points = triangulate(scene.rays, given)
        adjusted, *_ = bundle_adjust(given, points, pixels, Lens(CAMERA), num_fixed=1)
        last: FloatArray = adjusted[-1]
        return last

    return Comparison(
        "local bundle adjustment",
        "m",
        ours,
        library,
        lambda pose: _distance(pose, poses[-1]),
    )


@single_threaded_blas
def measure(comparison: Comparison, rounds: int) -> str:
    """One line: both times, their ratio, and both errors."""
    solvers, milliseconds, errors = (comparison.ours, comparison.library), [], []
    for solve in solvers:
        errors.append(comparison.error(solve()))  # compiles, too
        milliseconds.append(1e3 * float(np.median([timed(solve)[1][1] for _ in range(rounds)])))
    (ours_ms, library_ms), (ours, library) = milliseconds, errors
    return (
        f"{comparison.name}: ours {ours_ms:.3g} ms, library {library_ms:.3g} ms, ratio "
        f"{library_ms / ours_ms:.1f}; "
        f"error {ours:.2g} and {library:.2g} {comparison.unit}"
    )


def _rigid(pose: FloatArray) -> pycolmap.Rigid3d:
    return pycolmap.Rigid3d(pycolmap.Rotation3d(pose[:3, :3]), pose[:3, 3])


def _matrix(result: dict[str, pycolmap.Rigid3d] | None, name: str) -> FloatArray:
    assert result is not None  # on data made here
    matrix = np.asarray(result[name].matrix())
    return se3.compose(matrix[:, :3], matrix[:, 3])


def _unit(pose: FloatArray) -> FloatArray:
    return se3.compose(pose[:3, :3], pose[:3, 3] / np.linalg.norm(pose[:3, 3]))


def _distance(cam_from_world: FloatArray, truth: FloatArray) -> float:
    return float(np.linalg.norm(se3.inverse(cam_from_world)[:3, 3] - se3.inverse(truth)[:3, 3]))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each solver."""
    parser = rounds_parser(
        "performance.libraries", "Time and error of our solvers and of library solvers.", 20
    )
    rounds = parser.parse_args(arguments).rounds
    scene = Scene.random()
    for problem in (
        triangulation,
        resection,
        relative_pose,
        local_bundle_adjustment,
    ):
        print(measure(problem(scene), rounds))


if __name__ == "__main__":
    main()
