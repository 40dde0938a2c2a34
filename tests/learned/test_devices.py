import pytest
import torch

from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.types import Clip, PrivilegedInput
from geovp_learned import devices


@pytest.mark.parametrize(("is_there", "expected"), [(True, "cuda"), (False, "cpu")])
def test_auto_is_a_gpu_where_there_is_one(
    is_there: bool, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: is_there)
    assert devices.resolved("auto") == expected


@pytest.mark.parametrize("device", ["abacus", "cuda:99"])
def test_a_device_that_is_not_here_is_refused_in_one_sentence(device: str) -> None:
    with pytest.raises(
        BadData, match=rf"device '{device}' cannot be used \(.*\): give 'cpu' or 'auto'"
    ):
        devices.resolved(device)


def test_learned_parts_say_what_they_compute_on() -> None:
    with registry.defaults(device="auto"):
        chained = registry.build(
            "pose_sources", {"name": "chained", "odometry": "deepvo", "forecaster": "hold"}
        )
    here = "cuda" if torch.cuda.is_available() else "cpu"
    assert chained.odometry.device == registry.describe(chained)["odometry"]["device"] == here
    assert f"parameters on {here}" in chained.odometry.weights_note


def test_what_a_part_says_itself_comes_first() -> None:
    with registry.defaults(device="abacus"):
        assert registry.build("predictors", {"name": "svg", "device": "cpu"}).device == "cpu"
        assert registry.describe(registry.build("predictors", "copy-last")) == {
            "name": "copy-last"
        }  # it has none
        with pytest.raises(BadData, match=r"frame_metrics: device 'abacus' cannot be used"):
            registry.build("frame_metrics", "lpips")
    assert registry.build("frame_metrics", "lpips").device is None  # as in results of before


@pytest.mark.parametrize("name", ["synsin", "srvp", "deepvo"])
def test_networks_give_the_same_bits_with_any_number_of_threads(name: str) -> None:
    clip = registry.build(
        "datasets", {"name": "synthetic", "num_clips": 3, "num_frames": 14, "size_px": [128, 128]}
    )[2]
    before, found = torch.get_num_threads(), []
    try:
        for count in (1, 2):
            torch.set_num_threads(count)
            found.append(_bytes_of(name, clip))
            assert torch.get_num_threads() == count
    finally:
        torch.set_num_threads(before)
    assert found[0] == found[1]


def _bytes_of(name: str, clip: Clip) -> bytes:
    context, _ = clip.split(5, ~PrivilegedInput.NONE)
    if name == "srvp":
        return bytes(registry.build("predictors", name).predict(context).frames.tobytes())
    if name == "deepvo":
        return bytes(registry.build("pose_sources", name).estimate(context).futures.tobytes())
    scene = registry.build("renderers", name).reconstruct(context, context.past)
    views = scene.view(context.future.world_from_cam, context.future.times_s, context.intrinsics)
    return bytes(views.frames.tobytes() + views.depths.tobytes())


def test_tasks_run_on_one_thread_each_and_the_number_of_threads_stays() -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        assert devices.on_one_thread_each(
            lambda task: (task, torch.get_num_threads()), range(5)
        ) == [(task, 1) for task in range(5)]
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
