"""Rotation drift of odometry against the recorded poses and against a bundle adjustment of SIFT.

COLMAP's SIFT features of all images are triangulated with the poses of the odometry and adjusted
together with them (Schoenberger & Frahm 2016), with the recorded intrinsics. The result shares
neither tracks nor drift with the odometry. What both differ by from the recorded poses is therefore
an error of the recording or of the calibration.
"""

import argparse
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pycolmap

from geovp_benchmarks.cli.options import option
from geovp_benchmarks.tables.formats import grid
from geovp_benchmarks.trajectories.odometry import track_sequences
from geovp_classic import registry
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import ByteArray, FloatArray, Intrinsics

ARGUMENTS = {
    "": {
        "root DIR": "Folder of KITTI odometry.",
        "frames FRAMES = 03[0:360)": option("Sequence or a part of it.", nargs="?"),
    }
}


def run(args: argparse.Namespace) -> Iterator[str]:
    """Yield the drift of the odometry and of the bundle adjustment."""
    data = {"name": "kitti", "root": args.root}
    stretch, path = next(track_sequences(data, [args.frames], {"name": "monocular"}))
    dataset = {**data, "sequences": [args.frames], "num_frames": 2}
    recording = registry.build("datasets", dataset).recordings[stretch.sequence]
    numbers = range(len(recording.frames))[stretch.first : stretch.last]
    greys = (pinhole.grey8(recording.frames.read(number)) for number in numbers)
    estimate = path.estimate
    with tempfile.TemporaryDirectory() as folder:
        adjusted = adjust_sift(greys, recording.intrinsics, estimate.world_from_cam, Path(folder))
    lengths = [se3.step_lengths(poses).sum() for poses in (estimate.world_from_cam, adjusted)]
    adjusted[:, :3, 3] *= lengths[0] / lengths[1]
    reference = replace(estimate, world_from_cam=adjusted)
    comparisons = {
        ("odometry", "recorded poses"): path,
        ("bundle adjustment", "recorded poses"): replace(path, estimate=reference),
        ("odometry", "bundle adjustment"): replace(path, truth=reference),
    }
    lines = [["poses", "compared with", "r_rel (deg/100m)", "RPE (deg)"]]
    for names, compared in comparisons.items():
        _, r_rel, _, _, rotation = compared.errors("sim3")
        lines.append([*names, f"{r_rel:.3f}", f"{rotation:.4f}"])
    yield from grid(lines)


def adjust_sift(
    greys: Iterable[ByteArray],  # [H, W] each
    camera: Intrinsics,
    world_from_cam: FloatArray,  # [T, 4, 4], initial poses
    folder: Path,  # for COLMAP's files
    num_rounds: int = 3,  # of bundle adjustment and removal of outliers
    max_error_px: float = 2.0,
) -> FloatArray:
    """Return the poses [T, 4, 4] after a bundle adjustment of SIFT features of all images."""
    # SIFT features of all images, matched between neighbours.
    frames = folder / "frames"
    frames.mkdir()
    for number, grey in enumerate(greys):
        cv2.imwrite(str(frames / f"{number:06d}.png"), grey)
    database = folder / "database.db"
    centre = f"{camera.cx_px + 0.5},{camera.cy_px + 0.5}"  # the corner of COLMAP's image is (0, 0)
    reader = pycolmap.ImageReaderOptions(
        camera_model="PINHOLE", camera_params=f"{camera.fx_px},{camera.fy_px},{centre}"
    )
    pycolmap.extract_features(
        database, frames, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader
    )
    pycolmap.match_sequential(database)

    # A model of the initial poses, with points triangulated from them.
    model = pycolmap.Reconstruction()
    with pycolmap.Database.open(database) as stored:
        (colmap_camera,) = stored.read_all_cameras()
        images = stored.read_all_images()
    model.add_camera_with_trivial_rig(colmap_camera)
    cam_from_world = se3.inverse(world_from_cam)
    for image in images:
        number = int(Path(image.name).stem)
        pose = pycolmap.Rigid3d(cam_from_world[number, :3])
        posed = pycolmap.Image(name=image.name, camera_id=1, image_id=image.image_id)
        model.add_image_with_trivial_frame(posed, pose)
    model = pycolmap.triangulate_points(model, database, frames, folder)

    # Robust bundle adjustment, and removal of outliers, in turn.
    options = pycolmap.BundleAdjustmentOptions(
        refine_focal_length=False, refine_extra_params=False, print_summary=False
    )
    options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    for _ in range(num_rounds):
        pycolmap.bundle_adjustment(model, options)
        pycolmap.ObservationManager(model).filter_all_points3D(max_error_px, 1.0)
    adjusted = {image.name: image.cam_from_world().matrix() for image in model.images.values()}
    matrices = np.stack([adjusted[name] for name in sorted(adjusted)])
    return se3.inverse(se3.compose(matrices[:, :3, :3], matrices[:, :3, 3]))
