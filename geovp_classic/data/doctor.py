"""Check of a data set's folder: all of its sequences, and all that is wrong, by file and line.

A loader stops at the first error of what it needs; the doctor reads every sequence, camera and
pose, and warns of content that no car or camera produces.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geovp_classic.data import layouts, splits
from geovp_classic.data.findings import Finding, Findings
from geovp_classic.data.frames import image_size, read_image
from geovp_classic.data.scan import Scan
from geovp_classic.data.undistortion import common_pinhole
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray

NO_POSES = (
    "has no recorded poses: it serves for prediction without ground truth"
)
Size = tuple[int, int]  # (width, height)


@dataclass(frozen=True)
class Examination:
    """The contents of a root, and its findings."""

    rows: tuple[
        dict[str, str], ...
    ]  # a table row for every sequence, by column
    findings: tuple[Finding, ...]  # sequence by sequence
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
    max_step_ratio: float = (
        1.8  # a longer time step, in medians, is a dropped frame
    )
    max_off_centre_ratio: float = (
        0.2  # of the principal point, in widths and heights
    )

    def examine(
        self,
        root: Path,
        *,
        deep: bool = False,
        watch: Callable[[list[str]], Iterable[str]] = iter,
    ) -> Examination:
        """Examine everything under a root; with `deep` every image is decoded.

        The sequences' names go through `watch` one by one, which may show a progress bar (tqdm
        does). BadData only if the root holds no sequences at all.
        """
        layout = layouts.LAYOUTS[layouts.name_of(root)]
        folders = layout.folders(root)
        if not folders:
            raise BadData(
                f"{root} holds no sequence: give a folder with sequences in it"
            )
        rows = []
        findings = Findings()
        num_frames = {}
        for name in watch(list(folders)):
            scans = layout.scans(folders[name])
            row, sequence_findings = self._sequence(
                name, folders[name], scans, deep=deep
            )
            rows.append(row)
            findings += sequence_findings
            num_frames[name] = min(len(scan.images) for scan in scans.values())
        return Examination(
            tuple(rows), tuple(findings), _usable_splits(num_frames)
        )

    def _sequence(
        self, name: str, folder: Path, scans: dict[str, Scan], *, deep: bool
    ) -> tuple[dict[str, str], Findings]:
        """Return the table row of a sequence with its cameras, and its findings.

        Times and poses are those of the first camera.
        """
        findings = Findings()
        frames = []
        sizes_px: set[Size] = set()
        focals = set()
        for camera, scan in scans.items():
            frames.append(f"{camera}: {len(scan.images)}".removeprefix(": "))
            findings += scan.findings
            camera_sizes_px = _image_sizes(scan.images, findings, deep=deep)
            sizes_px |= camera_sizes_px
            focals.add(
                self._calibration(folder, scan, camera_sizes_px, findings)
            )
        first = next(iter(scans.values()))
        times_s = first.times_s[np.isfinite(first.times_s)]
        duration_s = float(np.ptp(times_s)) if len(times_s) else 0.0
        self._times(first, findings)
        length = self._poses(folder, first, findings)
        findings = Findings(dict.fromkeys(findings))  # cameras share files
        severities = [finding.severity for finding in findings]
        row = {
            "sequence": name,
            "frames": ", ".join(frames),
            "size_px": ", ".join(map(_text, sorted(sizes_px))) or "-",
            "calibrated": ", ".join(sorted(focals)),
            "times": str(len(times_s)),
            "duration_s": f"{duration_s:.1f}",
            "poses": "none"
            if first.world_from_cam is None
            else str(len(first.posed)),
            "length_m": length,
            "errors": str(severities.count("error")),
            "warnings": str(severities.count("warning")),
        }
        return row, findings

    def _calibration(
        self, folder: Path, scan: Scan, sizes_px: set[Size], findings: Findings
    ) -> str:
        """Check that cameras fit their images; return the focal length as text.

        It is the focal length without distortion.
        """
        calibrated = {camera.size_px for camera in scan.cameras}
        if not calibrated:
            return "none"
        if unknown := sizes_px - calibrated:
            expected = ", ".join(map(_text, sorted(calibrated)))
            message = f"has images of {_text(min(unknown))}, calibrated for {expected}"
            findings.error(folder, message)
        try:
            view = common_pinhole(scan.cameras, folder)
        except BadData as problem:
            findings.add(folder, problem)
            return "none"
        right = view.cx_px / view.width_px
        down = view.cy_px / view.height_px
        if max(abs(right - 0.5), abs(down - 0.5)) > self.max_off_centre_ratio:
            message = (
                f"has the principal point at {right:.0%} of the width, {down:.0%} of the height: "
                "were images resized or cropped without the calibration?"
            )
            findings.warn(folder, message)
        return f"f {view.fx_px:.0f} px"

    def _times(self, scan: Scan, findings: Findings) -> None:
        """Warn of images much later than the one before."""
        steps_s = np.diff(scan.times_s)
        if not np.isfinite(steps_s).any():
            return
        usual_s = float(np.nanmedian(steps_s))
        message = f"{{:.3f}} s after the image before, {usual_s:.3f} s is usual: frames are missing"
        _warn_beyond(
            self.max_step_ratio * usual_s,
            steps_s,
            scan.images,
            message,
            findings,
        )

    def _poses(self, folder: Path, scan: Scan, findings: Findings) -> str:
        """Warn of missing poses and implausible motion.

        Return the length of the path in metres as text, "-" if it is unknown.
        """
        numbers = scan.posed
        count = len(scan.images)
        if scan.world_from_cam is None and count and not scan.findings:
            findings.note(folder, NO_POSES)
        if len(numbers) < count and not scan.findings:
            message = (
                f"{count - len(numbers)} of {count} images have no pose: "
                f"{len(scan.breaks) + 1} unbroken pieces are left"
            )
            findings.warn(folder, message)
        if scan.depths is not None and (missing := scan.depths.count(None)):
            findings.warn(
                folder, f"{missing} of {count} images have no depth image"
            )
        if scan.world_from_cam is None or len(numbers) < 2:
            return "-"
        images = [scan.images[number] for number in numbers]
        poses = scan.world_from_cam[numbers]
        earlier_from_later = se3.inverse(poses[:-1]) @ poses[1:]
        turns_deg = np.degrees(se3.rotation_angle_rad(earlier_from_later))
        message = "turned by {:.0f} degrees from the pose before: more than a car turns"
        _warn_beyond(self.max_turn_deg, turns_deg, images, message, findings)
        if not scan.is_metric:
            return "-"
        steps_m = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
        speeds_m_s = steps_m / np.diff(scan.times_s[numbers])
        message = "{:.0f} m/s from the pose before: more than a car drives"
        _warn_beyond(self.max_speed_m_s, speeds_m_s, images, message, findings)
        return f"{steps_m.sum():.0f}"


def _warn_beyond(
    limit: float,
    steps: FloatArray,  # [N - 1]
    images: Sequence[Path],  # N
    message: str,
    findings: Findings,
) -> None:
    """Warn of the images at the end of steps beyond a limit."""
    for step in np.flatnonzero(steps > limit):
        findings.warn(images[int(step) + 1], message.format(steps[step]))


def _text(size_px: Size) -> str:
    """Return "WIDTHxHEIGHT"."""
    return f"{size_px[0]}x{size_px[1]}"


def _image_sizes(
    images: tuple[Path, ...], findings: Findings, *, deep: bool
) -> set[Size]:
    """Return every size that occurs; report damaged images and those of another size.

    The first image, or with `deep` every one, is decoded.
    """
    sizes_px: list[Size] = []
    for path in images:
        try:
            size_px = image_size(path)
            if deep or not sizes_px:
                read_image(path)
        except BadData as problem:
            findings.add(path, problem)
            continue
        if sizes_px and size_px not in sizes_px:
            message = f"is {_text(size_px)} pixels, but those before are {_text(sizes_px[0])}"
            findings.error(path, message)
        sizes_px.append(size_px)
    return set(sizes_px)


def _usable_splits(num_frames: dict[str, int]) -> tuple[str, ...]:
    """Return the named splits whose frames are all among the sequences' first `num_frames`."""
    usable = []
    for name in splits.names():
        ranges = splits.load(name)
        needed = {
            frames.sequence: frames.last or frames.first + 1
            for frames in ranges
        }
        if all(
            num_frames.get(sequence, 0) >= count
            for sequence, count in needed.items()
        ):
            usable.append(name)
    return tuple(usable)
