"""The small commands end in a sentence and exit code 2 for a user's mistake, whatever it is."""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.commands import command, whole_numbers
from benchmarks.performance import clip, odometry, splat
from geovp_classic.errors import BadData


def test_a_command_prints_its_text(capsys: pytest.CaptureFixture[str]) -> None:
    assert command(lambda arguments: " and ".join(arguments))(["one", "two"]) == 0
    assert capsys.readouterr().out == "one and two\n"


def test_what_is_not_the_users_mistake_is_raised() -> None:
    def broken(_: Sequence[str]) -> str:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        command(broken)([])


def test_numbers_not_given_are_the_defaults() -> None:
    assert whole_numbers([], (8, 0), "") == [8, 0]
    assert whole_numbers(["3"], (8, 0), "") == [3, 0]
    assert whole_numbers(["3", "5"], (8, 0), "") == [3, 5]
    for wrong in (["three"], ["-3"], ["1", "2", "3"]):
        with pytest.raises(BadData, match=r"expected \[A \[B\]\], whole numbers"):
            whole_numbers(wrong, (8, 0), "[A [B]]")


@pytest.mark.parametrize(
    ("main", "arguments", "told"),
    [
        (clip.main, ["often"], "expected [ROUNDS [ROOT SEQUENCE]]"),
        (splat.main, ["often"], "expected [ROUNDS]"),
        (odometry.main, [], "expected IMAGES CALIB [COUNT]"),
        (odometry.main, ["nowhere", "calib.txt"], "calib.txt: does not exist"),
        (odometry.main, ["nowhere", "calib.txt", "0"], "counts of at least 1"),
        (splat.main, ["0"], "counts of at least 1"),
        (clip.main, ["0"], "counts of at least 1"),
    ],
)
def test_mistakes_give_one_sentence(
    main: Callable[[Sequence[str]], int], arguments: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert told in captured.err
    assert captured.err.count("\n") == 1
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
    assert odometry.main([str(images), str(calib)]) == 2
    assert "notes.txt" in capsys.readouterr().err
    (images / "notes.txt").unlink()
    assert odometry.main([str(images), str(calib), "1"]) == 2
    assert "a folder of two or more images" in capsys.readouterr().err
