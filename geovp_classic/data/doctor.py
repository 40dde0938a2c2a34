"""Check of a data set's folder: all of its sequences, and all that is wrong, by file and line.

A loader stops at the first error of what it needs; the doctor reads every sequence, camera and
pose, and warns of content that no car or camera produces.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geovp_classic.data.findings import FileFinding, Findings
from geovp_classic.data.formats.pose_files import clock_of
from geovp_classic.data.frames.image_frames import Size, image_size, read_image
from geovp_classic.data.frames.undistortion import common_pinhole
from geovp_classic.data.layouts import detection
from geovp_classic.data.recordings import splits, windows
from geovp_classic.data.recordings.scans import Scan
from geovp_classic.data.recordings.sequences import SequenceDataset
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Examination:
    """The contents of a root, and its findings."""

    rows: tuple[dict[str, str], ...]  # a table row for every sequence, by column
    findings: tuple[FileFinding, ...]  # sequence by sequence
    usable_splits: tuple[str, ...]  # the named splits whose frames are all here

    @property
    def is_sound(self) -> bool:
        """Return whether there is no error; there may be warnings and notes."""
        return not any(finding.severity == "error" for finding in self.findings)


@dataclass(frozen=True)
class Doctor:
    """An examination of data sets with the limits of plausible content."""

    max_speed_m_s: float = 60.0  # 216 km/h; 26 m/s at most in KITTI
    max_turn_deg: float = 20.0  # between two frames; 5 degrees at most in KITTI
    # a longer time step, in medians, is a dropped frame: one makes a step of 2
    max_step_ratio: float = 1.8
    # of the principal point, in widths and heights: 0.04 in KITTI; images that lost their right
    # third without a change of the calibration have 0.25
    max_off_centre_ratio: float = 0.2

    def examine(
        self,
        root: Path,
        settings: Mapping[str, Any] | None = None,  # of the data set
        *,
        deep: bool = False,
        watch: Callable[[list[str]], Iterable[str]] = iter,
    ) -> Examination:
        """Examine everything under a root; with `deep` every image is decoded.

        The sequences' names go through `watch` one by one, which may show a progress bar (tqdm
        does). BadData only if the root holds no sequences at all.
        """
        layout, dataset = detection.detect(root, settings)
        folders = dataset.folders()
        if not folders:
            raise BadData(
                f"{root} is laid out like {layout} but holds no sequence: unpack one into it, with "
                f"the names that docs/guide/{layout}.md shows"
            )
        rows = []
        all_findings: list[FileFinding] = []
        num_frames = {}
        for name in watch(list(folders)):
            findings = Findings()
            scans = dataset.scans(folders[name], findings)
            row = self._examine(dataset, folders[name], scans, findings, deep)
            distinct = dict.fromkeys(findings)  # cameras share files
            all_findings += distinct
            severities = [finding.severity for finding in distinct]
            row["errors"] = str(severities.count("error"))
            row["warnings"] = str(severities.count("warning"))
            rows.append({"sequence": name, **row})
            num_frames[name] = min(len(scan.images) for scan in scans.values())
        return Examination(tuple(rows), tuple(all_findings), _usable_splits(num_frames))

    def _examine(
        self,
        dataset: SequenceDataset,
        folder: Path,
        scans: dict[str, Scan],
        findings: Findings,
        deep: bool,
    ) -> dict[str, str]:
        """Return the numbers of a sequence's table row.

        Times and poses are those of the first camera.
        """
        first = next(iter(scans.values()))
        is_readable = not findings
        # images and calibration of each camera
        frames = [f"{camera}: {len(scan.images)}" for camera, scan in scans.items()]
        sizes_px: set[Size] = set()
        focals = set()
        for scan in scans.values():
            camera_sizes_px = _image_sizes(scan, findings, deep, dataset)
            sizes_px |= camera_sizes_px
            focals.add(self._examine_cameras(folder, scan, camera_sizes_px, findings))
        if is_readable and not first.cameras:
            message = "has no known camera: give its field of view, intrinsics or a calibration"
            findings.add(folder, message, severity="note")
        # a longer step between images than usual means that some were dropped
        times_s = first.times_s[np.isfinite(first.times_s)]
        usual_s = np.nan
        if len(times_s) > 1:
            usual_s = float(np.median(np.diff(times_s)))
        _warn_beyond(
            self.max_step_ratio * usual_s,
            np.diff(first.times_s),
            first.images,
            f"{{:.3f}} s after the image before, {usual_s:.3f} s is usual: frames are missing",
            findings,
        )
        if is_readable and first.images:
            _examine_gaps(folder, first, findings)
        _examine_depths(folder, first, findings, deep)
        return {
            "frames": ", ".join(frames).removeprefix(": "),
            "size_px": ", ".join(map(_text, sorted(sizes_px))) or "-",
            "calibrated": ", ".join(sorted(focals)),
            "times": str(len(times_s)),
            "clock": clock_of(times_s),
            "duration_s": f"{np.ptp(times_s) if len(times_s) else 0:.1f}",
            "poses": "none" if first.world_from_cam is None else str(len(first.posed)),
            "length_m": self._examine_motion(first, findings),
        }

    def _examine_cameras(
        self, folder: Path, scan: Scan, sizes_px: set[Size], findings: Findings
    ) -> str:
        """Check that cameras fit their images; return the focal length without distortion."""
        calibrated = {camera.size_px for camera in scan.cameras}
        if not calibrated:
            return "none"
        if unknown := sizes_px - calibrated:
            expected = ", ".join(map(_text, sorted(calibrated)))
            findings.add(
                folder,
                f"has images of {_text(min(unknown))}, calibrated for {expected}",
            )
        with findings.catch(folder):
            view = common_pinhole(scan.cameras, folder)
            windows.check_plausible(str(folder), view)
            right = view.cx_px / view.width_px
            down = view.cy_px / view.height_px
            if max(abs(right - 0.5), abs(down - 0.5)) > self.max_off_centre_ratio:
                findings.add(
                    folder,
                    f"has the principal point at {right:.0%} of the width, {down:.0%} of the "
                    "height: were images resized or cropped without the calibration?",
                    severity="warning",
                )
            return f"f {view.fx_px:.0f} px"
        return "none"

    def _examine_motion(self, scan: Scan, findings: Findings) -> str:
        """Warn of implausible motion.

        Return the length of the path in metres as text, "-" if it is unknown.
        """
        numbers = scan.posed
        if scan.world_from_cam is None or len(numbers) < 2:
            return "-"
        # rotation between poses, and speed where the unit is known
        images = [scan.images[number] for number in numbers]
        poses = scan.world_from_cam[numbers]
        turns_deg = np.degrees(se3.rotation_angle_rad(se3.steps(poses)))
        message = "turned by {:.0f} degrees from the pose before: more than a car turns"
        _warn_beyond(self.max_turn_deg, turns_deg, images, message, findings)
        if not scan.is_metric:
            return "-"
        steps_m = se3.step_lengths(poses)
        speeds_m_s = steps_m / np.diff(scan.times_s[numbers])
        message = "{:.0f} m/s from the pose before: more than a car drives"
        _warn_beyond(self.max_speed_m_s, speeds_m_s, images, message, findings)
        return f"{steps_m.sum():.0f}"


def _examine_depths(folder: Path, scan: Scan, findings: Findings, deep: bool) -> None:
    """Report missing depth images, and bad ones: the first and the last, or with `deep` each."""
    depths = scan.depths or ()
    if None in depths:
        message = f"{depths.count(None)} of {len(depths)} images have no depth image"
        findings.add(folder, message, severity="warning")
    for number, path in enumerate(depths):
        if scan.cameras and path and (deep or path in (depths[0], depths[-1])):
            with findings.catch(path):
                scan.depth_maps.read(number)


def _examine_gaps(folder: Path, scan: Scan, findings: Findings) -> None:
    """Report images without a pose, and a sequence that no clip can be cut from."""
    count, num_posed = len(scan.images), len(scan.posed)
    max_length = int(np.diff([0, *scan.breaks, num_posed]).max())
    if scan.world_from_cam is None:
        findings.add(
            folder,
            "has no recorded poses: it serves for prediction without ground truth",
            severity="note",
        )
    elif not num_posed:
        first_s, last_s = scan.times_s[0], scan.times_s[-1]
        findings.add(
            folder,
            f"none of {count} images, from {first_s:.3f} to {last_s:.3f} s, has a pose at its "
            "time: give both in seconds on one clock (poses in ns are 1e9 times too large)",
        )
    elif num_posed < count:
        findings.add(
            folder,
            f"{count - num_posed} of {count} images have no pose: "
            f"{len(scan.breaks) + 1} unbroken pieces are left",
            severity="warning",
        )
    if max_length == 1:
        findings.add(
            folder,
            f"has no two images in a row{' with poses' if max_length < count else ''}: a clip "
            "needs 2 or more, to observe and to predict",
        )


def _warn_beyond(
    limit: float,
    steps: FloatArray,  # [N - 1]
    images: Sequence[Path],  # N
    message: str,
    findings: Findings,
) -> None:
    """Warn of the images at the end of steps beyond a limit."""
    for step in np.flatnonzero(steps > limit):
        findings.add(
            images[int(step) + 1],
            message.format(steps[step]),
            severity="warning",
        )


def _text(size_px: Size) -> str:
    """Return "WIDTHxHEIGHT"."""
    return f"{size_px[0]}x{size_px[1]}"


def _image_sizes(scan: Scan, findings: Findings, deep: bool, dataset: SequenceDataset) -> set[Size]:
    """Return every size that occurs; report damaged images and those of another size.

    The first and the last image, or with `deep` every one, are decoded. Images that are not files
    are not examined otherwise.
    """
    sizes_px: list[Size] = []
    for number, path in enumerate(scan.images):
        with findings.catch(path):
            must_decode = deep or path in (scan.images[0], scan.images[-1])
            if scan.reader is None:
                size_px = image_size(path, is_upright=dataset.is_upright)
                if must_decode:
                    read_image(path, dataset.image_bits)
            elif must_decode:
                size_px = scan.reader.read(number).shape[1::-1]
            if sizes_px and size_px not in sizes_px:
                message = f"is {_text(size_px)} pixels, but those before are {_text(sizes_px[0])}"
                findings.add(path, message)
            sizes_px.append(size_px)
    return set(sizes_px)


def _usable_splits(num_frames: dict[str, int]) -> tuple[str, ...]:
    """Return the named splits whose frames are all among the sequences' first `num_frames`."""
    return tuple(
        name
        for name in splits.names()
        if all(
            num_frames.get(frames.sequence, 0) >= (frames.last or frames.first + 1)
            for frames in splits.load(name)
        )
    )
