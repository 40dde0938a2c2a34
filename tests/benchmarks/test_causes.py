"""Labels of clips: attributes, errors and fallbacks that put a clip among the hardest quarter."""

from pathlib import Path

import pytest

from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables import causes
from tests.benchmarks.made import write_protocol, write_row

CLIPS = [f"c{number}" for number in range(8)]
PSNR = {"role": "frame", "unit": "dB", "higher_is_better": True}
ERROR = {"role": "trajectory", "unit": "m", "higher_is_better": False}


@pytest.fixture
def results(tmp_path: Path) -> Results:
    """Clip n turns by 10 n degrees at 5 m/s, has n dB and n - 3 m of error; the last is a copy."""
    results = Results(tmp_path)
    metrics = {"psnr": PSNR, "final-displacement": ERROR, "average-displacement": ERROR}
    write_protocol(results, ["m"], CLIPS, metrics=metrics)
    rows = []
    for number, clip in enumerate(CLIPS):
        rows.append((clip, 0, 20, "psnr", float(number)))
        rows.append((clip, 0, 20, "final-displacement", max(0.0, number - 3.0)))
        rows.append((clip, 0, 20, "average-displacement", max(0.0, number - 4.0)))
    facts = {
        clip: {"yaw_deg": 10.0 * number, "speed_m_s": 5.0, "weather": "rain" if number else "sun"}
        for number, clip in enumerate(CLIPS)
    }
    write_row(results, "m", rows, facts, {"c7": "last-frame", "c6": "geometry"})
    return Results(tmp_path)


def test_labels_are_of_the_hardest_quarter_and_of_fallbacks(results: Results) -> None:
    """Two of eight clips; the equal speeds set none apart. Of two errors in metres, one labels."""
    (method,) = results.methods()
    labels = causes.of_clips(results, method)
    assert labels["c0"] == ["weather: sun"]
    assert labels["c5"] == ["weather: rain"]
    assert labels["c6"] == ["weather: rain", "large turn", "large final displacement"]
    assert labels["c7"] == [*labels["c6"], "shown by the last frame"]


def test_frequent_labels_are_overrepresented_among_the_worst() -> None:
    """Label a has 2 of 2 worst and 1 of 4 others, b 1 and 0, c 1 and 4."""
    labels = {"v": ["a", "c"], "w": ["b", "a"], "x": ["a", "c"], "y": ["c"], "z": ["c"], "u": ["c"]}
    assert causes.frequent(labels, ["v", "w"]) == [("a", 2, 1), ("b", 1, 0)]
