"""What the best of k samples scores on average, over k: how much there is to gain from guessing often."""

from __future__ import annotations

import numpy as np

from benchmarks import statistics
from benchmarks.plots import curves, style
from benchmarks.plots.material import Material, Page, numbered, title


def pages(material: Material, metric: str) -> list[Page]:
    """The figures of one metric; none where no cell has several samples."""
    facts = material.protocol["metrics"][metric]
    found = []
    for cell in (cell for cell in material.cells if cell.num_samples > 1):
        cube = statistics.cube(material.rows[cell.name], metric)
        if cube.values.shape[1] > 1 and np.isfinite(cube.values).any():
            found.append((cell.label, statistics.per_step(statistics.expected_best(cube, facts["higher_is_better"]))))
    if not found:
        return []
    strokes = style.strokes([(label, "") for label, _ in found])
    lines = [
        curves.Curve(label, np.arange(1.0, len(best.mean) + 1), best.mean, best.error, stroke)
        for (label, best), stroke in zip(found, strokes, strict=True)
    ]
    measure = curves.Measure(title(metric), facts["unit"], facts["higher_is_better"], None, "samples to choose from")
    words = style.Words(
        f"{title(metric)} of the best of k samples",
        f"{material.data}: chosen by the real future; mean over sets of k and over clips, band ± one standard error",
    )
    return numbered("samples", metric, metric, words, curves.draw(lines, measure, words))
