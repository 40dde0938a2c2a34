"""The clip benchmark runs the real parts, and adds up."""

import numpy as np

from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.pose_sources.refined import Refined
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.types import PrivilegedInput
from performance import clip as benchmark


def test_the_stages_give_what_the_predictor_gives() -> None:
    one = Synthetic(num_clips=1, size_px=(96, 96))[0]
    source = Refined(Chained())
    context, _ = one.split(10, source.needs | DepthFusion().needs)
    views, seconds = benchmark.one_clip(context)
    whole = GeometricPredictor(source, DepthFusion()).predict(context)
    np.testing.assert_array_equal(views.frames, whole.frames[0])
    assert len(seconds) == len(benchmark.STAGES)
    assert all(clock > 0 and processor >= 0 for clock, processor in seconds)


def test_medians_of_stages_and_of_their_sum() -> None:
    # after the warm-up three rounds; by the clock the stages take 0.1 s each, in the last 0.3 s:
    # sums of seven stages 0.7, 0.7, 2.1
    taken_s = np.full((4, 7, 2), 0.1)
    taken_s[3, :, 0] = 0.3
    taken_s[..., 1] = 0.2
    taken_s[0] = 1.5
    lines = benchmark.lines(taken_s)
    assert [float(word) for word in lines[1].split() if word.isdigit()] == [100, 200]
    assert [float(word) for word in lines[8].split() if word.isdigit()] == [700, 1400]
    assert lines[-1].startswith(
        "first round 10.5 s, of the processor 10.5 s; peak memory of the process "
    )


def test_the_parts_are_the_defaults_but_for_the_frames() -> None:
    refined, renderer = benchmark.parts("crop")
    assert (refined, renderer) == (Refined(Chained()), DepthFusion())
    wide, fusion = benchmark.parts("full")
    assert PrivilegedInput.FULL_FRAMES in wide.needs & fusion.needs
    assert [type(one) for one in wide.refinements] == [type(one) for one in refined.refinements]
