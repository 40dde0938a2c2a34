"""The ablation study: what each part is worth."""

from pathlib import Path

from geovp_classic import registry
from studies.ablation import variants
from tests.benchmarks.conftest import Says, write_kitti


def test_all_variants_can_be_built_and_differ_from_the_whole() -> None:
    by_part = {variant.part: variant for variant in variants()}
    for part, variant in by_part.items():
        registry.build("pose_sources", variant.pose_source)
        registry.build("renderers", variant.renderer)
        whole = by_part[variant.whole]
        is_same = (variant.pose_source, variant.renderer) == (whole.pose_source, whole.renderer)
        assert is_same == part.startswith("all"), part


def test_the_gain_of_a_part_is_printed(tmp_path: Path, printed: Says) -> None:
    spec = {"name": "synthetic", "num_clips": 1, "num_frames": 30, "size_px": [64, 64]}
    write_kitti(tmp_path, "03", registry.build("datasets", spec)[0])
    text = printed("study", "ablation", tmp_path, "03", "--only", "exposure")
    head, names, line = text.splitlines()
    assert head == "1 clips of 03"
    assert names.split()[0] == "without"
    assert line.startswith("exposure ")
