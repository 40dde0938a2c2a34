import pytest
import torch

from benchmarks.performance import splatting_torch


def test_both_ways_draw_the_same_and_are_timed() -> None:
    timing = splatting_torch.measure(side_px=32)
    assert timing.difference < 1e-5
    assert min(timing.forward_s, timing.backward_s, timing.dense_s) > 0
    first, second = timing.lines()
    assert first.startswith(f"32x32 points, 16 features: forward {1e3 * timing.forward_s:.0f} ms")
    assert f"({timing.dense_s / timing.forward_s:.0f} times as long)" in second


def test_a_device_that_is_not_here_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert splatting_torch.main(["32", "tpu"]) == 2
    assert "device 'tpu': expected cpu, or cuda where there is a GPU" in capsys.readouterr().err
    assert splatting_torch.main(["32", "cpu", "more"]) == 2
    assert "device 'cpu more': expected cpu" in capsys.readouterr().err
    assert splatting_torch.main(["0"]) == 2
    assert "counts of at least 1" in capsys.readouterr().err


def test_the_street_is_seen_from_three_metres_ahead() -> None:
    positions, inverse_depths, visible, _ = splatting_torch.street(32, "cpu")
    # the lowest middle pixel's road, 1.65 m below: z = 1.65 * 60.8 / 15.5 = 6.47 m (at most 1 % nearer), then 3 m less
    lowest = 31 * 32 + 16
    assert bool(visible[0, lowest])
    torch.testing.assert_close(1 / inverse_depths[0, lowest], torch.tensor(3.44), rtol=0, atol=0.04)
    assert float(positions[0, lowest, 1]) > 31  # has left the image below
