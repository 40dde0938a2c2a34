"""All of these need torch; networks as small as these only wait for one another on more threads
than one.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

REASON = "torch is not installed: the learned parts need the extra 'learned'"


def pytest_pycollect_makemodule() -> None:
    """Skip what needs torch before it is imported; the report says why."""
    pytest.importorskip("torch", reason=REASON)


@pytest.fixture(autouse=True, scope="session")
def one_thread() -> Iterator[None]:
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def lpips_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A folder with LPIPS's npz files, of random networks that pass for the real ones."""
    from geovp_learned import lpips
    from geovp_learned.tensors import images_from_frames

    rng, scores = np.random.default_rng(0), {}
    for net in get_args(lpips.Net):
        weights = {}
        for name, tensor in lpips.LpipsNetwork(net).state_dict().items():
            deviation = (np.prod(tensor.shape[1:]) + 1) ** -0.5
            drawn = rng.normal(0, deviation, tensor.shape).astype(np.float32)
            if name.startswith("linear."):
                weights[name.replace("linear.", "lin")] = np.abs(drawn).ravel()
            else:
                weights[name.removeprefix("backbone.")] = drawn
        np.savez(tmp_path / f"lpips_{net}_v0.1.npz", **weights)
        network = lpips._network_of(net, weights)
        scores[net] = float(network(*map(images_from_frames, lpips.check_images())))
    monkeypatch.setattr(lpips, "CHECK_SCORES", scores)
    return tmp_path
