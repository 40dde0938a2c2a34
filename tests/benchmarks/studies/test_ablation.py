"""Ablation study: gain of each component."""

from pathlib import Path

import pytest

from geovp_classic import registry
from studies.ablation import variants
from tests.benchmarks.conftest import Says, write_kitti


def test_all_variants_differ_from_their_default() -> None:
    available = variants()
    for name, variant in available.items():
        if variant.default:
            assert variant.predictor != available[variant.default].predictor, name


@pytest.mark.usefixtures("lpips_weights")
def test_the_gain_of_a_component_is_printed(tmp_path: Path, printed: Says) -> None:
    spec = {"name": "synthetic", "num_clips": 1, "num_frames": 30, "size_px": [64, 64]}
    write_kitti(tmp_path, "03", registry.build("datasets", spec)[0])
    text = printed("study", "ablation", tmp_path, "03", "--only", "exposure")
    lines = text.splitlines()
    assert lines[0] == "## Gain of components on clips of 03"
    assert lines[4].split("|")[1:3] == [" exposure ", "     1 "]
