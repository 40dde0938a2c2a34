from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

WITH = "not installed: the extra 'onnx' has it"
pytest.importorskip("onnx", reason=f"onnx is {WITH}")
pytest.importorskip("onnxscript", reason=f"onnxscript is {WITH}")
onnxruntime = pytest.importorskip("onnxruntime", reason=f"onnxruntime is {WITH}")

import street  # noqa: E402

from geovp_classic.types import FloatArray  # noqa: E402
from geovp_learned import __main__ as command  # noqa: E402
from geovp_learned import export, lpips  # noqa: E402
from geovp_learned.deepvo.network import motions  # noqa: E402
from geovp_learned.deepvo.poses import DeepVo  # noqa: E402


def run(file: Path, **inputs: Any) -> list[FloatArray]:
    return list(onnxruntime.InferenceSession(str(file)).run(None, inputs))


def test_deepvo_gives_the_same_steps_elsewhere(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, clip, predictor = tmp_path / "deepvo.onnx", street.clip(), DeepVo()
    assert (
        command.main(["export", "deepvo", "--onnx", str(file), "--past", "6", "--future", "4"]) == 0
    )
    assert capsys.readouterr().out == f"{file}: images [1, 6, 3, 96, 96] to past and future\n"
    images = predictor.images(list(clip.frames[:6]), clip.intrinsics)
    past, future = run(file, images=images[None].numpy())
    assert (past.shape, future.shape) == ((1, 5, 3), (1, 4, 3))
    trajectory, ahead = predictor.poses(images, clip.times_s)
    world_from_cam, expected = np.eye(4), [*trajectory.world_from_cam[1:], *ahead]
    for step, pose in zip(np.concatenate([past, future], axis=1)[0], expected, strict=True):
        world_from_cam = world_from_cam @ motions(torch.from_numpy(step).double(), "2d").numpy()
        np.testing.assert_allclose(world_from_cam, pose, atol=1e-4)


def test_lpips_gives_the_same_distances_elsewhere_for_any_number_of_images(
    tmp_path: Path, lpips_folder: Path
) -> None:
    file = tmp_path / "lpips.onnx"
    given = ["--weights", str(lpips_folder), "--size", "64"]
    assert command.main(["export", "lpips", "--onnx", str(file), *given]) == 0
    rng = np.random.default_rng(0)
    predicted, target = rng.integers(0, 256, (2, 5, 64, 64, 3), dtype=np.uint8)
    images = (np.moveaxis(frames, -1, 1).astype(np.float32) / 255 for frames in (predicted, target))
    (distances,) = run(file, **dict(zip(("predicted", "target"), images, strict=True)))
    expected = lpips.Lpips(weights=lpips_folder)(predicted, target)
    assert expected.min() > 0.01
    np.testing.assert_allclose(distances, expected, rtol=1e-4)


def test_what_cannot_be_exported_is_said_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert command.main(["export", "synsin", "--onnx", str(tmp_path / "s.onnx")]) == 2
    assert "'synsin' cannot be exported to ONNX: known are deepvo, lpips" in capsys.readouterr().err
    assert command.main(["export", "deepvo", "--onnx", str(tmp_path / "no/d.onnx")]) == 2
    assert "no is not a folder: make it, or give another --onnx" in capsys.readouterr().err
    monkeypatch.setattr(export, "NEEDS", ("onnx", "onnx_of_tomorrow"))
    assert command.main(["export", "deepvo", "--onnx", str(tmp_path / "d.onnx")]) == 2
    assert (
        "export needs onnx_of_tomorrow, which is not installed: pip install"
        in capsys.readouterr().err
    )
