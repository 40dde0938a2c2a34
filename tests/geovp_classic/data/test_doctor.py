"""The doctor lists the contents of a folder, and finds every error in one go."""

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from video_files import grey_levels, write_video

from geovp_classic.data.doctor import Doctor
from geovp_classic.data.layouts.kitti import Kitti
from geovp_classic.errors import BadData

Edit = Callable[[Path, int, str], None]


def reported(root: Path, **settings: bool) -> list[str]:
    """Return findings as "severity file:line message"."""
    return [
        f"{finding.severity} {finding.path.relative_to(root)}:{finding.line or ''} "
        f"{finding.message}"
        for finding in Doctor().examine(root, **settings).findings
    ]


def has(findings: list[str], *starts: str) -> bool:
    """Return whether a finding begins with each of the starts, and there are no others."""
    matched = {start for start in starts if any(line.startswith(start) for line in findings)}
    return matched == set(starts) and all(line.startswith(starts) for line in findings)


def test_a_sound_root_has_no_findings(kitti_root: Path) -> None:
    seen: list[str] = []

    def watch(names: list[str]) -> Iterator[str]:
        for name in names:
            seen.append(name)
            yield name

    examination = Doctor().examine(kitti_root, deep=True, watch=watch)
    assert seen == ["00", "01"]
    assert examination.is_sound
    assert examination.findings == ()
    assert examination.rows[0] == {
        "sequence": "00",
        "frames": "image_2: 12, image_3: 12",
        "size_px": "64x24",
        "calibrated": "f 50 px",
        "times": "12",
        "clock": "time since the start",
        "duration_s": "1.1",
        "poses": "12",
        "length_m": "11",
        "errors": "0",
        "warnings": "0",
    }
    assert examination.rows[1]["frames"] == "image_0: 12"
    assert examination.usable_splits == ()


def test_all_errors_are_found_at_once(kitti_root: Path, edit: Edit) -> None:
    folder = kitti_root / "sequences" / "00"
    edit(kitti_root / "poses" / "00.txt", 2, "1 0 0 nan 0 1 0 0 0 0 1 1")
    edit(kitti_root / "poses" / "00.txt", 4, "1 0 0 0")
    edit(kitti_root / "poses" / "00.txt", 9, "1 2 3 0 0 1 0 0 0 0 1 8")
    edit(folder / "times.txt", 5, "0.3")
    edit(folder / "calib.txt", 3, "P2: 50 0 31.5")
    cv2.imwrite(str(folder / "image_2" / "000008.png"), np.zeros((10, 20), np.uint8))
    image = folder / "image_3" / "000002.png"
    image.write_bytes(image.read_bytes()[:50])
    assert has(
        reported(kitti_root),
        "error sequences/00/image_2/000008.png: is 20x10 pixels, but those before are 64x24",
        "error sequences/00/image_3/000002.png: cannot be decoded as an image",
        "error sequences/00/calib.txt:3 3 numbers, expected 12",
        "error sequences/00/times.txt:5 0.3 is not after 0.3",
        "error poses/00.txt:2 'nan' is not a finite number",
        "error poses/00.txt:4 4 numbers, expected 12",
        "error poses/00.txt:9 a rotation matrix is off by 13",
    )
    row = Doctor().examine(kitti_root).rows[0]
    assert (row["errors"], row["poses"], row["times"]) == ("7", "none", "11")
    assert not Doctor().examine(kitti_root).is_sound


def test_missing_files_are_found(kitti_root: Path) -> None:
    folder = kitti_root / "sequences" / "01"
    (folder / "calib.txt").unlink()
    (folder / "times.txt").unlink()
    (folder / "image_0" / "000006.png").unlink()
    for name in ("000002.jpg", "readme.txt"):
        (folder / "image_0" / name).touch()
    (kitti_root / "poses" / "01.txt").rename(kitti_root / "poses" / "07.txt")
    (kitti_root / "sequences" / "02").mkdir()
    assert has(
        reported(kitti_root),
        "error sequences/01/calib.txt: does not exist",
        "error sequences/01/times.txt: does not exist",
        "error sequences/01/image_0: lacks frame 000006",
        "error sequences/01/image_0/000002.png: has the same number as 000002.jpg",
        "error sequences/01/image_0/000002.jpg: cannot be decoded as an image",
        "note sequences/01/image_0/readme.txt: is not a numbered image",
        "error sequences/02/image_2: holds no images",
        "error sequences/02/times.txt: does not exist",
    )
    assert Doctor().examine(kitti_root).rows[1]["poses"] == "none"


def test_implausible_content_is_a_warning(kitti_root: Path, edit: Edit) -> None:
    edit(kitti_root / "poses" / "01.txt", 12, "1 0 0 0 0 1 0 0 0 0 1 20")  # 10 m in 0.1 s
    edit(kitti_root / "poses" / "01.txt", 1, "0 0 1 0 0 1 0 0 -1 0 0 0")  # 90 degrees
    edit(kitti_root / "sequences" / "01" / "times.txt", 12, "1.4")
    edit(kitti_root / "sequences" / "01" / "calib.txt", 1, "P0: 50 0 60 0 0 50 11 0 0 0 1 0")
    images = "warning sequences/01/image_0"
    assert has(
        reported(kitti_root),
        "warning sequences/01: has the principal point at 94% of the width, 46% of the height",
        f"{images}/000011.png: 0.400 s after the image before, 0.100 s is usual",
        f"{images}/000001.png: turned by 90 degrees from the pose before",
    )
    edit(kitti_root / "sequences" / "01" / "times.txt", 12, "1.1")
    assert f"{images}/000011.png: 100 m/s from the pose before: more than a car drives" in reported(
        kitti_root
    )
    assert Doctor().examine(kitti_root).is_sound
    # beyond 64 pixels, no data set accepts the camera
    edit(kitti_root / "sequences" / "01" / "calib.txt", 1, "P0: 50 0 70 0 0 50 11 0 0 0 1 0")
    assert not Doctor().examine(kitti_root).is_sound


@pytest.mark.parametrize(
    ("times_per_s", "unit"), [(1e3 / 3.3, "ms"), (1e3, "ms"), (1e6, "us"), (1e9, "ns")]
)
def test_times_in_another_unit_are_an_error(
    times_per_s: float, unit: str, kitti_root: Path
) -> None:
    """At 10 Hz, 0.1 s are 100 ms; at 33 Hz, 30 ms would be 30 s."""
    lines = [f"{index / 10 * times_per_s:.6f}" for index in range(12)]
    (kitti_root / "sequences/01/times.txt").write_text("\n".join(lines))
    (error,) = [each for each in reported(kitti_root) if each.startswith("error")]
    start = f"error sequences/01/times.txt: the usual step between times is {0.1 * times_per_s:.6g}"
    assert error == f"{start}, as of times in {unit}: give times in s, 0.001 to 5 s apart"
    with pytest.raises(BadData, match="give times in s"):
        Kitti(kitti_root)


def test_an_input_of_which_no_clip_can_be_cut_has_an_error(tmp_path: Path) -> None:
    """One image, in a folder or alone, and one frame of a video."""
    image = np.full((24, 32, 3), 90, np.uint8)
    for name in ("folder/a.png", "a.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / name), image)
    write_video(tmp_path / "a.mp4", [image])
    for name in ("folder", "a.png", "a.mp4"):
        findings = Doctor().examine(tmp_path / name).findings
        lines = [f"{each.severity}: {each.message}" for each in findings]
        notes = ("note: has no known camera", "note: has no recorded poses")
        assert has(lines, "error: has no two images in a row: a clip needs 2 or more", *notes), name


def test_a_change_of_size_is_found_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "a.h264"
    content = b""
    for size_px in ((64, 48), (32, 24)):
        content += write_video(path, grey_levels(4, size_px=size_px), format="h264").read_bytes()
    path.write_bytes(content)
    errors = [each for each in Doctor().examine(path).findings if each.severity == "error"]
    assert [error.path.name for error in errors] == ["frame 7"]
    assert "frame 7 of 8 is damaged or has another size" in errors[0].message


def test_a_root_without_sequences_is_refused(tmp_path: Path) -> None:
    for name in (
        "kitti/sequences",
        "raw/2011_09_26",
        "nerf/transforms.json",
        "a/sequences/b/image_0",
    ):
        (tmp_path / name).mkdir(parents=True)
    for name, message in (
        ("kitti", r"like kitti but holds no sequence: unpack one .*guide/kitti\.md"),
        ("raw", r"like kitti-raw but holds no sequence"),
        ("a/sequences", "is a part of KITTI odometry: give its root, .*/a$"),
        ("a/sequences/b/image_0", "give its root, .*/a$"),
        ("none", "does not exist"),
        ("nerf", r"transforms\.json is not read: .* give the COLMAP model"),
    ):
        root = tmp_path / name
        with pytest.raises(BadData, match=message):
            Doctor().examine(root)
