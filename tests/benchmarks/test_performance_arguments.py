"""Wrong arguments of the performance scripts end with a message and exit code 2."""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.performance import clip, odometry, splat


@pytest.mark.parametrize(
    ("main", "arguments", "message"),
    [
        (clip.main, ["often"], "argument ROUNDS: invalid"),
        (clip.main, ["3", "--kitti", "root"], "argument --kitti: expected 2 arguments"),
        (splat.main, ["often"], "argument ROUNDS: invalid"),
        (odometry.main, [], "the following arguments are required: IMAGES, CALIB"),
        (odometry.main, ["nowhere", "calib.txt"], "calib.txt: does not exist"),
        (odometry.main, ["nowhere", "calib.txt", "0"], "0 is not a whole number of 1 or more"),
        (splat.main, ["0"], "0 is not a whole number of 1 or more"),
        (clip.main, ["0"], "0 is not a whole number of 1 or more"),
    ],
)
def test_wrong_arguments_end_with_exit_code_2(
    main: Callable[[Sequence[str]], None], arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(arguments)
    captured = capsys.readouterr()
    assert message in captured.err
    assert not captured.out


def test_a_folder_with_something_else_in_it_is_no_folder_of_images(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    images, calib = tmp_path / "images", tmp_path / "calib.txt"
    images.mkdir()
    cv2.imwrite(str(images / "0.png"), np.zeros((8, 8), np.uint8))
    cv2.imwrite(str(images / "1.png"), np.zeros((8, 8), np.uint8))
    calib.write_text("P0: 7 0 3.5 0 0 7 3.5 0 0 0 1 0\n")
    frames, camera = odometry.read(images, calib, 5)
    assert len(frames) == 2
    assert (camera.fx_px, camera.cx_px, camera.width_px) == (7, 3.5, 8)
    (images / "notes.txt").write_text("no image")
    with pytest.raises(SystemExit, match="2"):
        odometry.main([str(images), str(calib)])
    assert "notes.txt" in capsys.readouterr().err
    (images / "notes.txt").unlink()
    with pytest.raises(SystemExit, match="2"):
        odometry.main([str(images), str(calib), "1"])
    assert "a folder of two or more images" in capsys.readouterr().err
