from pathlib import Path

import numpy as np
import pytest

from geovp_learned.lpips import WEIGHTS_VARIABLE, Lpips
from geovp_learned.synsin import losses
from geovp_learned.tensors import images_from_frames


def test_content_is_lpips_with_a_gradient(
    lpips_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(WEIGHTS_VARIABLE, str(lpips_folder))
    rng = np.random.default_rng(0)
    made, real = rng.integers(0, 256, (2, 2, 64, 64, 3), dtype=np.uint8)
    frames = images_from_frames(made).requires_grad_()
    loss = losses.content_loss(frames, images_from_frames(real), "squeeze")
    assert float(loss.detach()) == pytest.approx(
        float(Lpips("squeeze")(made, real).mean()), abs=1e-5
    )
    loss.backward()
    assert frames.grad.abs().max() > 0
