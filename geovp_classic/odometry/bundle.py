"""Bundle adjustment of a window of keyframes by pycolmap."""

import numpy as np

from geovp_classic.colmap_library import pycolmap
from geovp_classic.odometry.lens import Lens
from geovp_classic.types import FloatArray

MAX_ITERATIONS = 8
FOCAL_ITERATIONS = 25
TOLERANCE = 1e-3  # relative decrease of the cost at which it stops


def bundle_adjust(
    cam_from_world: FloatArray,  # [K, 4, 4]
    points: FloatArray,  # [N, 3]
    pixels: FloatArray,  # [K, N, 2]; NaN where a keyframe does not observe a point
    lens: Lens,
    num_fixed: int = 2,
    robust_px: float = 0.5,  # errors beyond this count less (soft L1)
) -> tuple[FloatArray, FloatArray]:
    """Adjusted poses [K, 4, 4] and points [N, 3]; the first `num_fixed` keyframes stay, which fixes
    the gauge.

    With one fixed, the length of one baseline is kept instead. The input is returned when the
    solver fails. Every point needs two observations or more.
    """
    model = _model(cam_from_world, points, pixels, lens)
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.images:
        config.add_image(image_id)
    config.set_constant_cam_intrinsics(1)
    if num_fixed >= 2:
        for image_id in range(1, num_fixed + 1):
            config.set_constant_rig_from_world_pose(image_id)
    else:
        config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    summary = pycolmap.create_default_bundle_adjuster(_options(robust_px), config, model).solve()
    if not summary.is_solution_usable():
        return cam_from_world, points
    found = model.points3D
    moved = np.array([found[j + 1].xyz for j in range(len(points))]).reshape(-1, 3)
    poses = np.tile(np.eye(4), (len(cam_from_world), 1, 1))
    for k in range(len(cam_from_world)):
        poses[k, :3] = model.images[k + 1].cam_from_world().matrix()
    if not (np.isfinite(poses).all() and np.isfinite(moved).all()):
        return cam_from_world, points
    return poses, moved


def adjusted_focal(
    cam_from_world: FloatArray,  # [K, 4, 4]
    points: FloatArray,  # [N, 3]
    pixels: FloatArray,  # [K, N, 2]; NaN where a keyframe does not observe a point
    lens: Lens,
) -> float:
    """The focal length in pixels that a bundle adjustment of it, the poses and the points ends at;
    NaN if it fails.
    """
    model = _model(cam_from_world, points, pixels, lens, square=True)
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.images:
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    options = _options(robust_px=0.5)
    options.refine_focal_length = True
    options.ceres.loss_function_type = (
        pycolmap.LossFunctionType.CAUCHY
    )  # a wrong focal length makes outliers
    options.ceres.solver_options.max_num_iterations = FOCAL_ITERATIONS
    summary = pycolmap.create_default_bundle_adjuster(options, config, model).solve()
    return float(model.cameras[1].params[0]) if summary.is_solution_usable() else np.nan


def _model(
    cam_from_world: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    lens: Lens,
    *,
    square: bool = False,
) -> pycolmap.Reconstruction:
    """The window as a reconstruction of pycolmap, with undistorted pixels; identifiers count from
    1.
    """
    model, camera = pycolmap.Reconstruction(), lens.camera
    centre = [camera.cx_px, camera.cy_px]
    kind, params = "PINHOLE", [camera.fx_px, camera.fy_px, *centre]
    if square:
        kind, params = "SIMPLE_PINHOLE", [lens.focal_px, *centre]
    size = {"width": camera.width_px, "height": camera.height_px}
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(model=kind, params=params, camera_id=1, **size)
    )
    ideal = np.nan_to_num(Lens(camera).pixels(lens.rays(pixels)))
    for k, pose in enumerate(cam_from_world):
        image = pycolmap.Image(name=str(k), keypoints=ideal[k], camera_id=1, image_id=k + 1)
        model.add_image_with_trivial_frame(
            image, pycolmap.Rigid3d(pycolmap.Rotation3d(pose[:3, :3]), pose[:3, 3])
        )
    tracks = [pycolmap.Track() for _ in points]
    image_ids, indices = np.nonzero(np.isfinite(pixels[..., 0]))
    for image_id, j in zip((image_ids + 1).tolist(), indices.tolist(), strict=True):
        tracks[j].add_element(image_id, j)
    for point, track in zip(points, tracks, strict=True):
        model.add_point3D(point, track)
    return model


def _options(robust_px: float) -> pycolmap.BundleAdjustmentOptions:
    options = pycolmap.BundleAdjustmentOptions(
        refine_focal_length=False,
        refine_principal_point=False,
        refine_extra_params=False,
        print_summary=False,
    )
    options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    options.ceres.loss_function_scale = robust_px
    options.ceres.solver_options.max_num_iterations = MAX_ITERATIONS
    options.ceres.solver_options.function_tolerance = TOLERANCE
    options.ceres.solver_options.num_threads = 1  # the same sums in the same order every time
    return options
