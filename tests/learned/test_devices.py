import numpy as np
import pytest
import torch

from geovp_classic import registry
from geovp_classic.types import Clip, FloatArray, PrivilegedInput
from geovp_learned import devices


@pytest.mark.parametrize(("is_there", "expected"), [(True, "cuda"), (False, "cpu")])
def test_auto_is_a_gpu_where_there_is_one(
    is_there: bool, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: is_there)
    assert devices.resolved("auto") == expected


def predicted(name: str, clip: Clip) -> FloatArray:
    context, _ = clip.split(5, ~PrivilegedInput.NONE)
    if name == "srvp-tiny":
        return registry.build("predictors", name).predict(context).frames.astype(float)
    if name == "deepvo-small":
        return registry.build("pose_sources", name).estimate(context).futures
    scene = registry.build("renderers", name).reconstruct(context, context.past)
    future = context.future
    views = scene.view(future.world_from_cam, future.times_s, context.intrinsics)
    return views.frames.astype(float)


@pytest.mark.parametrize(
    ("name", "atol"), [("synsin-small", 1), ("srvp-tiny", 1), ("deepvo-small", 1e-6)]
)
def test_networks_do_not_depend_on_the_number_of_threads(name: str, atol: float) -> None:
    spec = {"name": "synthetic", "num_clips": 3, "num_frames": 14, "size_px": [128, 128]}
    clip = registry.build("datasets", spec)[2]
    expected = predicted(name, clip)
    torch.set_num_threads(2)
    try:
        np.testing.assert_allclose(predicted(name, clip), expected, atol=atol)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(1)
