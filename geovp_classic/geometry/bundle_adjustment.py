"""Bundle adjustment (Triggs et al. 2000) by pycolmap."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geovp_classic.colmap_library import pycolmap
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import FloatArray, Intrinsics

CountArray = npt.NDArray[np.int64]

SOFT_L1 = pycolmap.LossFunctionType.SOFT_L1
CAUCHY = pycolmap.LossFunctionType.CAUCHY


def bundle_adjust(
    cam_from_world: FloatArray,  # [K, 4, 4]
    points: FloatArray,  # [N, 3], each with two observations or more
    pixels: FloatArray,  # [K, N, 2]; NaN where a camera does not observe a point
    camera: Intrinsics,
    num_fixed: int = 2,
    robust_px: float = 0.5,  # scale of the soft L1 loss
) -> tuple[FloatArray, FloatArray]:
    """Return the adjusted poses [K, 4, 4] and points [N, 3]; the input if the solver fails.

    The first `num_fixed` cameras stay. With only one fixed, the length of a baseline stays, too.
    """
    model = reconstruction(cam_from_world, points, *_square(pixels, camera))
    config = _config(model, num_fixed)
    if num_fixed == 1:
        config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    if not _solve(model, _options(robust_px), config):
        return cam_from_world, points
    adjusted = [model.points3D[n + 1].xyz for n in range(len(points))]
    return _poses(model), np.array(adjusted)


@dataclass(frozen=True)
class AnchoredAdjustment:
    """Adjustment of given poses, which are the prior.

    The prior consists of fixed points, the anchors. A camera observes its anchors where its given
    pose shows them. Poses that the images confirm therefore stay. Poses that they contradict by
    pixels lose their prior, since the loss is robust.
    """

    # Scale of Cauchy's loss: two standard deviations of a tracked corner
    robust_px: float = 0.5
    # Weight of the pixels of the first camera: the points hardly leave its rays.
    first_weight: int = 8
    anchor_weight: int = 2  # pycolmap needs two observations of a point
    # Of the angle between the rays of the anchors and the axis: 27 degrees, as the image's border
    tangent: float = 0.5
    # Depth of near anchors, which fix the position, over the distance from the first camera: a
    # change of a hundredth of it shifts them by a pixel at a focal length of 400 px.
    near_depth: float = 4.0
    # Depth of far anchors, which fix the rotation, over the longest distance: the
    # parallax is a tenth of a pixel at a focal length of 1000 px.
    far_depth: float = 1e4
    # Of Levenberg-Marquardt, which a smaller relative decrease of the cost ends
    max_rounds: int = 20
    min_decrease: float = 1e-4

    def adjust(
        self,
        cam_from_world: FloatArray,  # [K, 4, 4]; the first is the identity and stays
        points: FloatArray,  # [N, 3], each with two observations or more
        pixels: FloatArray,  # [K, N, 2]; NaN where a camera does not observe a point
        camera: Intrinsics,
    ) -> FloatArray:
        """Return the adjusted poses [K, 4, 4]; the given ones if the solver fails."""
        anchors, anchor_pixels = self._anchors(cam_from_world, camera)
        pixels = np.concatenate([pixels, anchor_pixels], axis=1)
        weights = np.ones(pixels.shape[:2], int)
        weights[0] = self.first_weight
        weights[:, len(points) :] = self.anchor_weight
        all_points = np.concatenate([points, anchors])
        square = _square(pixels, camera)
        model = reconstruction(cam_from_world, all_points, *square, weights)
        options = _options(self.robust_px, CAUCHY, self.max_rounds, self.min_decrease)
        config = _config(model, num_fixed=1)
        for n in range(len(points), len(all_points)):
            config.add_constant_point(n + 1)
        if not _solve(model, options, config):
            return cam_from_world
        return _poses(model)

    def _anchors(
        self,
        cam_from_world: FloatArray,  # [K, 4, 4]
        camera: Intrinsics,
    ) -> tuple[FloatArray, FloatArray]:
        """Return points [A, 3], and their pixels [K, A, 2] in the cameras that observe them.

        Each camera but the first observes four near points and four far ones.
        """
        num_cameras = len(cam_from_world)
        world_from_cam = se3.inverse(cam_from_world)
        distances = np.linalg.norm(world_from_cam[:, :3, 3], axis=1)
        max_distance = distances.max()
        near = self.near_depth * np.maximum(distances, 1e-3 * max_distance)
        far = self.far_depth * max_distance
        across = self.tangent * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
        rays = np.column_stack([across, np.ones(4)])
        anchors = []
        pixels = np.full((num_cameras, 8 * (num_cameras - 1), 2), np.nan)
        for k in range(1, num_cameras):
            located = np.concatenate([near[k] * rays, far * rays])
            anchors.append(se3.transform(world_from_cam[k], located))
            shown, _ = pinhole.project(located, camera)
            pixels[k, 8 * (k - 1) : 8 * k] = shown
        return np.concatenate(anchors), pixels


def adjust_focal(
    cam_from_world: FloatArray,  # [K, 4, 4]
    points: FloatArray,  # [N, 3], each with two observations or more
    pixels: FloatArray,  # [K, N, 2]; NaN where a camera does not observe a point
    camera: Intrinsics,
) -> float:
    """Return the focal length in pixels after an adjustment of it, the poses and the points.

    The result is NaN if the solver fails. A wrong focal length makes outliers, hence a Cauchy loss.
    """
    model = reconstruction(cam_from_world, points, *_square(pixels, camera))
    options = _options(0.5, CAUCHY, max_rounds=25)
    options.refine_focal_length = True
    config = _config(model, num_fixed=1)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    if not _solve(model, options, config):
        return np.nan
    return float(model.cameras[1].params[0])


def reconstruction(
    cam_from_world: FloatArray,  # [K, 4, 4]
    points: FloatArray,  # [N, 3]
    pixels: FloatArray,  # [K, N, 2] as COLMAP counts them; NaN: not observed
    camera: pycolmap.Camera,  # with camera_id = 1
    # [K, N], how often an observation counts; default: once
    weights: CountArray | None = None,
) -> pycolmap.Reconstruction:
    """Return a reconstruction of images and points; their identifiers count from 1."""
    # How often each image observes each point
    counts = np.isfinite(pixels[..., 0]).astype(int)
    if weights is not None:
        counts *= weights
    # Images with their keypoints, one for each observation
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(camera)
    tracks = [pycolmap.Track() for _ in points]
    for k, pose in enumerate(cam_from_world):
        observed = np.repeat(np.arange(len(points)), counts[k])
        for keypoint, n in enumerate(observed.tolist()):
            tracks[n].add_element(k + 1, keypoint)
        image = pycolmap.Image(
            name=str(k),
            keypoints=pixels[k, observed],
            camera_id=1,
            image_id=k + 1,
        )
        rigid = pycolmap.Rigid3d(pycolmap.Rotation3d(pose[:3, :3]), pose[:3, 3])
        model.add_image_with_trivial_frame(image, rigid)
    # Points with the keypoints that show them
    for point, track in zip(points, tracks, strict=True):
        model.add_point3D(point, track)
    return model


def _square(pixels: FloatArray, camera: Intrinsics) -> tuple[FloatArray, pycolmap.Camera]:
    """Return the pixels [..., 2] of a camera with square pixels, and this camera."""
    centre = np.array([camera.cx_px, camera.cy_px])
    rays = pinhole.normalised(pixels, camera)
    square = pycolmap.Camera(
        model="SIMPLE_PINHOLE",
        params=[camera.fx_px, *centre],
        camera_id=1,
        width=camera.width_px,
        height=camera.height_px,
    )
    return camera.fx_px * rays + centre, square


def _poses(model: pycolmap.Reconstruction) -> FloatArray:
    """Return the poses [K, 4, 4] of all images."""
    poses = np.tile(np.eye(4), (len(model.images), 1, 1))
    for k in range(len(poses)):
        poses[k, :3] = model.images[k + 1].cam_from_world().matrix()
    return poses


def _options(
    robust_px: float,
    loss: pycolmap.LossFunctionType = SOFT_L1,
    max_rounds: int = 8,
    min_decrease: float = 1e-3,  # of the cost, relative; less ends the rounds
) -> pycolmap.BundleAdjustmentOptions:
    options = pycolmap.BundleAdjustmentOptions(
        refine_focal_length=False,
        refine_principal_point=False,
        refine_extra_params=False,
        print_summary=False,
    )
    options.ceres.loss_function_type = loss
    options.ceres.loss_function_scale = robust_px
    options.ceres.solver_options.max_num_iterations = max_rounds
    options.ceres.solver_options.function_tolerance = min_decrease
    options.ceres.solver_options.num_threads = 1  # more do not pay for a window
    return options


def _config(model: pycolmap.Reconstruction, num_fixed: int) -> pycolmap.BundleAdjustmentConfig:
    """Return the adjustment of all images but the first ones."""
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.images:
        config.add_image(image_id)
    for image_id in range(1, num_fixed + 1):
        config.set_constant_rig_from_world_pose(image_id)
    return config


def _solve(
    model: pycolmap.Reconstruction,
    options: pycolmap.BundleAdjustmentOptions,
    config: pycolmap.BundleAdjustmentConfig,
) -> bool:
    """Adjust the model in place, and return whether the solver succeeded."""
    adjuster = pycolmap.create_default_bundle_adjuster(options, config, model)
    return bool(adjuster.solve().is_solution_usable())
