"""Table 4.1 of the thesis in its own layout: our rows, and the published ones in a
separate block.
"""

import fnmatch
import tomllib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geovp_benchmarks.analysis import statistics
from geovp_benchmarks.results import provenance
from geovp_benchmarks.results.store import Method, Results
from geovp_benchmarks.results.stored_facts import legend, marks, summary
from geovp_benchmarks.tables.formats import grid
from geovp_benchmarks.tables.latex import tex_escaped
from geovp_classic.data import splits

METRICS = ("psnr", "ssim", "lpips")
HEAD = ("Models", "PSNR (↑)", "SSIM (↑)", "LPIPS (↓)")
PUBLISHED = "thesis-table-4-1"
STOCHASTIC = ("svg", "srvp", "slamp")
GEOMETRIC = {
    "Ours": ("deepvo",),
    "GT 2D Pose": ("planar", "ground-truth"),
    "GT 3D Pose": ("ground-truth",),
}
TRUTH = ("PAST_POSES", "FUTURE_POSES", "PAST_DEPTHS", "FUTURE_FRAMES")  # of no contender
DECIMALS = 3
FIGURES = {  # of the thesis: what it shows, and the names of our files
    "4.3": ("predicted paths", "paths-*.png"),
    "4.4": ("predicted sequences", "strip-*.png"),
    "4.5": ("PSNR over time", "horizon-psnr*.png"),
    "4.6": ("SSIM over time", "horizon-ssim*.png"),
    "4.7": ("LPIPS over time", "horizon-lpips*.png"),
    "4.8 to 4.10": (
        "failures on curves, dynamic objects, unseen areas: with --keep worst:psnr",
        "strip-*.png",
    ),
}
BOLD = (
    "Bold: the best of its column among methods without true poses or depths, as in the thesis; "
    "there, the oracle-selected best of many samples competes too"
)


@dataclass(frozen=True)
class Line:
    """A model with its mean and standard error in each of METRICS; None where it has none."""

    name: str
    rank: int  # place in the thesis's order; rows that it does not have come last
    values: tuple[tuple[float, float] | None, ...]
    privileged_inputs: Collection[str] = ()

    @property
    def competes(self) -> bool:
        """Whether its values may be the best of their columns."""
        return not set(TRUTH).intersection(self.privileged_inputs)


@dataclass(frozen=True)
class Block:
    """Lines under a heading, and the notes below them."""

    heading: str
    lines: Sequence[Line]
    notes: Sequence[str]

    def rows(self, emphasis: str, escaped: Callable[[str], str] = str) -> list[list[str]]:
        """Name and values as texts, the best of each column in `emphasis`, such as "**{}**"."""
        rows = [
            [escaped(line.name), *(escaped(_text(value)) for value in line.values)]
            for line in self.lines
        ]
        for i in range(len(METRICS)):
            best = self._best(i)
            for line, row in zip(self.lines, rows, strict=True):
                value = line.values[i]
                if line.competes and value is not None and _printed(value) == best:
                    row[i + 1] = emphasis.format(row[i + 1])
        return rows

    def _best(self, i: int) -> float:
        """The best mean as printed, so that rows that print the same are all in bold."""
        values = [line.values[i] for line in self.lines if line.competes]
        means = [_printed(value) for value in values if value is not None]
        return (min if METRICS[i] == "lpips" else max)(means, default=float("nan"))


def markdown(results: Results) -> str:
    """Both blocks, with notes."""
    parts: list[str] = []
    for block in blocks(results):
        table = grid([HEAD, *block.rows("**{}**")], numbers=False)
        parts += [f"## {block.heading}", "", *table, "", *(f"- {note}" for note in block.notes), ""]
    return "\n".join(parts)


def latex(results: Results) -> str:
    """Both blocks, each a `table` for the booktabs package with its notes."""
    lines: list[str] = []
    for block in blocks(results):
        head = " & ".join(map(tex_escaped, HEAD))
        body = [" & ".join(row) + r" \\" for row in block.rows(r"\textbf{{{}}}", tex_escaped)]
        lines += [r"\begin{table}", r"\centering", rf"\caption{{{tex_escaped(block.heading)}.}}"]
        lines += [
            rf"\begin{{tabular}}{{l{'c' * len(METRICS)}}}",
            r"\toprule",
            head + r" \\",
            r"\midrule",
            *body,
        ]
        lines += [r"\bottomrule", r"\end{tabular}", r"\par\footnotesize"]
        lines += [*(tex_escaped(note) + r"\\" for note in block.notes), r"\end{table}", ""]
    return "\n".join(lines)


FORMATS: Mapping[str, Callable[[Results], str]] = {"md": markdown, "tex": latex}


def figures(drawn: Sequence[str]) -> list[str]:
    """A line for every figure of the thesis with the files, among those drawn, that show the same
    of our rows.
    """
    lines = []
    for number, (words, pattern) in FIGURES.items():
        files = ", ".join(sorted(fnmatch.filter(drawn, pattern)))
        lines.append(f"figure {number} ({words}): {files or 'nothing to draw it from'}")
    return lines


def blocks(results: Results) -> tuple[Block, Block]:
    """What was measured here, and what was published."""
    protocol, methods = results.protocol(), results.methods()
    done = [method for method in methods if method.status in ("done", "partial")]
    lines = sorted((_line(method, results) for method in done), key=lambda line: line.rank)
    notes = [
        f"{summary(protocol)}.{_split(protocol)}",
        f"{statistics.KIND}. Methods with several samples: the best of each column, as in "
        "the thesis.",
        f"{BOLD}.",
        *_absences(methods, lines),
        *legend(methods),
        *provenance.weights_notes(methods),
        *provenance.id_notes(done, protocol),
    ]
    paper = published()
    theirs = [
        Line(
            row["name"],
            0,
            tuple(tuple(row[metric]) for metric in METRICS),
            row.get("privileged_inputs", ()),
        )
        for row in paper["row"]
    ]
    about = [
        f"{paper['source']}: {paper['about']}.",
        "Other test clips, other training data and metrics that are not defined there: compare "
        "orders, not digits.",
    ]
    heading = f"{protocol['name']}: measured here, in the layout of the thesis's table 4.1"
    return Block(heading, lines, notes), Block("Published, not measured here", theirs, about)


def _split(protocol: Mapping[str, Any]) -> str:
    """The frames of a split that has a name."""
    name = protocol["dataset"].get("split")
    return (
        f" Split {name}: {', '.join(map(str, splits.load(name)))}."
        if name in splits.names()
        else ""
    )


def _line(method: Method, results: Results) -> Line:
    name = _name(method)
    rows, values = results.scores(method.name), []
    for metric in METRICS:
        cube = statistics.cube(rows, metric)
        higher = metric != "lpips"
        reduce = (
            statistics.best_of_samples if method.num_samples > 1 else statistics.mean_of_samples
        )
        estimate = statistics.overall(reduce(cube, higher))
        values.append(
            (float(estimate.mean), float(estimate.error)) if int(estimate.count) else None
        )
    order = [_family(str(row["name"])) for row in published()["row"]]  # the thesis's
    if _family(name) in order:
        return Line(name, order.index(_family(name)), tuple(values), method.privileged_inputs)
    samples = f", best of {method.num_samples}" if method.num_samples > 1 else ""
    return Line(
        f"{name}{samples}" + (f" [{marks(method)}]" if method.privileged_inputs else ""),
        len(order),
        tuple(values),
        method.privileged_inputs,
    )


def _name(method: Method) -> str:
    """The thesis's name of such a method; the method's own label where it has none."""
    parts = method.components.get("predictor", method.components)
    if parts.get("name") in STOCHASTIC:
        return (
            f"{parts['name'].upper()} - {method.num_samples} Sample{'s' * (method.num_samples > 1)}"
        )
    source = parts.get("pose_source", {})
    names = tuple(filter(None, (source.get("name"), source.get("source", {}).get("name"))))
    if parts.get("renderer", {}).get("name") == "synsin":
        for name, sources in GEOMETRIC.items():
            if names == sources:
                return name if name == "Ours" else f"{name} + SynSin"
    return method.label


def _family(name: str) -> str:
    """The name with the number of samples reduced to one or many."""
    model, dash, count = name.partition(" - ")
    return f"{model}{dash}{'1' if count == '1 Sample' else 'many'}" if dash else name


def published(name: str = PUBLISHED) -> Mapping[str, Any]:
    """The numbers of a paper's table with their source."""
    return tomllib.loads(
        (Path(__file__).parents[1] / "published" / f"{name}.toml").read_text("utf-8")
    )


def _printed(value: tuple[float, float]) -> float:
    return round(value[0], DECIMALS)


def _text(value: tuple[float, float] | None) -> str:
    if value is None:
        return "-"
    error = "" if np.isnan(value[1]) else f" ± {value[1]:.{DECIMALS}f}"
    return f"{value[0]:.{DECIMALS}f}{error}"


def _absences(methods: Sequence[Method], present: Sequence[Line]) -> list[str]:
    """The thesis's rows that are missing here, methods that are not done, and clips that a method
    could not predict.
    """
    here = {line.rank for line in present}
    names = [str(row["name"]) for rank, row in enumerate(published()["row"]) if rank not in here]
    notes = [f"Not in these results: {', '.join(names)}."] if names else []
    other = [method for method in methods if method.status != "done"]
    notes += [
        f"{method.label}: {method.status}: {method.reason or 'run again'}." for method in other
    ]
    failed = [method for method in methods if method.num_failed]
    return notes + [
        f"{method.label}: {method.num_failed} of {method.num_clips} clips could not be predicted "
        "and count as copies of the last frame."
        for method in failed
    ]
