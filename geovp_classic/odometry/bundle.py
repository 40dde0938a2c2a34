"""Bundle adjustment of a window of keyframes by pycolmap."""

import numpy as np

from geovp_classic.colmap_library import pycolmap
from geovp_classic.geometry import pinhole
from geovp_classic.types import FloatArray, Intrinsics


def bundle_adjust(
    cam_from_world: FloatArray,  # [K, 4, 4]
    points: FloatArray,  # [N, 3], each with two observations or more
    pixels: FloatArray,  # [K, N, 2]; NaN where a keyframe does not observe a point
    camera: Intrinsics,
    num_fixed: int = 2,
    robust_px: float = 0.5,  # scale of the soft L1 loss
) -> tuple[FloatArray, FloatArray]:
    """Return the adjusted poses [K, 4, 4] and points [N, 3]; the input if the solver fails.

    The first `num_fixed` keyframes stay. With only one fixed, the length of a baseline stays, too.
    """
    model = reconstruction(cam_from_world, points, *_square(pixels, camera))
    if not _solve(model, _options(robust_px), num_fixed):
        return cam_from_world, points
    poses = cam_from_world.copy()
    for k in range(len(poses)):
        poses[k, :3] = model.images[k + 1].cam_from_world().matrix()
    adjusted = [model.points3D[n + 1].xyz for n in range(len(points))]
    return poses, np.array(adjusted)


def adjust_focal(
    cam_from_world: FloatArray,  # [K, 4, 4]
    points: FloatArray,  # [N, 3], each with two observations or more
    pixels: FloatArray,  # [K, N, 2]; NaN where a keyframe does not observe a point
    camera: Intrinsics,
) -> float:
    """Return the focal length in pixels after an adjustment of it, the poses and the points.

    The result is NaN if the solver fails. A wrong focal length makes outliers, hence a Cauchy loss.
    """
    model = reconstruction(cam_from_world, points, *_square(pixels, camera))
    options = _options(robust_px=0.5)
    options.refine_focal_length = True
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.solver_options.max_num_iterations = 25
    if not _solve(model, options, num_fixed=1):
        return np.nan
    return float(model.cameras[1].params[0])


def reconstruction(
    cam_from_world: FloatArray,  # [K, 4, 4]
    points: FloatArray,  # [N, 3]
    pixels: FloatArray,  # [K, N, 2] as COLMAP counts them; NaN: not observed
    camera: pycolmap.Camera,  # with camera_id = 1
) -> pycolmap.Reconstruction:
    """Return a reconstruction of images and points; their identifiers count from 1."""
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(camera)
    tracks = [pycolmap.Track() for _ in points]
    for k, pose in enumerate(cam_from_world):
        observed = np.flatnonzero(np.isfinite(pixels[k, :, 0])).tolist()
        for keypoint, n in enumerate(observed):
            tracks[n].add_element(k + 1, keypoint)
        image = pycolmap.Image(
            name=str(k),
            keypoints=pixels[k, observed],
            camera_id=1,
            image_id=k + 1,
        )
        rigid = pycolmap.Rigid3d(pycolmap.Rotation3d(pose[:3, :3]), pose[:3, 3])
        model.add_image_with_trivial_frame(image, rigid)
    for point, track in zip(points, tracks, strict=True):
        model.add_point3D(point, track)
    return model


def _square(
    pixels: FloatArray, camera: Intrinsics
) -> tuple[FloatArray, pycolmap.Camera]:
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


def _options(robust_px: float) -> pycolmap.BundleAdjustmentOptions:
    options = pycolmap.BundleAdjustmentOptions(
        refine_focal_length=False,
        refine_principal_point=False,
        refine_extra_params=False,
        print_summary=False,
    )
    options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    options.ceres.loss_function_scale = robust_px
    options.ceres.solver_options.max_num_iterations = 8
    options.ceres.solver_options.function_tolerance = 1e-3
    options.ceres.solver_options.num_threads = 1  # more do not pay for a window
    return options


def _solve(
    model: pycolmap.Reconstruction,
    options: pycolmap.BundleAdjustmentOptions,
    num_fixed: int,
) -> bool:
    """Adjust the model in place, and return whether the solver succeeded."""
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.images:
        config.add_image(image_id)
    if num_fixed == 1:
        config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    else:
        for image_id in range(1, num_fixed + 1):
            config.set_constant_rig_from_world_pose(image_id)
    adjuster = pycolmap.create_default_bundle_adjuster(options, config, model)
    return bool(adjuster.solve().is_solution_usable())
