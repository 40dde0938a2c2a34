"""Tables as LaTeX, for the packages booktabs and graphicx, never wider than the text."""

import math
from collections.abc import Iterator, Sequence

from geovp_benchmarks.tables.table_model import Column, MethodScores, Table

TEX = {letter: f"\\{letter}" for letter in "&%_#${}"} | {
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
}
TEX |= {"\\": r"\textbackslash{}", "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}"}
TEX |= {"±": r"$\pm$", "↑": r"$\uparrow$", "↓": r"$\downarrow$"}
TEXT_PT = 345.0  # width of the text in the article class at 10 pt, the narrowest in wide use
SMALL_PT, SCRIPT_PT, GAP_PT = 4.1, 3.3, 8.0  # a letter on average; between columns
OPEN, CLOSE, SIZE = (
    (r"\begin{table}", r"\centering"),
    r"\end{table}",
    r"\small\setlength{\tabcolsep}{4pt}",
)
MOST_LINES = 45  # of a page beside the notes
FIT = r"\ifdim\wd0>\textwidth\resizebox{\textwidth}{!}{\usebox0}\else\usebox0\fi"


def latex(table: Table) -> str:
    """Return a `table` with caption and label; more columns than the text is wide go into several
    parts, one below another.

    An interval stands below its mean. Whatever still is too wide is shrunk by LaTeX, which knows
    how wide the text is; parts that would be too high together become tables of one number.
    """
    caption = table.caption or f"{tex_escaped(table.title)}."
    parts, label = (
        [[r"\sbox0{%", *_tabular(table, columns), "}%", FIT] for columns in _parts(table)],
        table.label,
    )
    apart = len(parts) > 1 and sum(map(len, parts)) > MOST_LINES
    lines = [
        *OPEN,
        rf"\caption{{{caption}}}\label{{{label or f'tab:{table.name}'}}}",
        SIZE,
        *parts[0],
    ]
    for part in parts[1:]:
        again = [
            CLOSE,
            *OPEN,
            r"\addtocounter{table}{-1}",
            rf"\caption[]{{{caption} (Continued.)}}",
            SIZE,
        ]
        lines += [*(again if apart else [r"\par\medskip"]), *part]
    notes = [tex_escaped(note) + r"\par" for note in table.notes]
    lines += [
        r"\par\medskip",
        r"\begin{minipage}{\textwidth}\scriptsize\raggedright",
        *notes,
        r"\end{minipage}",
    ]
    return "\n".join([*lines, CLOSE, ""])


def _parts(table: Table) -> list[Sequence[Column]]:
    """Return the columns in as few parts of about equal width as fit the text."""
    names = max((len(row.name) + len(row.marks) for row in table.rows), default=6)
    free_pt = TEXT_PT - SMALL_PT * (names + 5) - 2 * GAP_PT
    widths_pt = [_width_pt(table, column) for column in table.columns]
    count = max(1, math.ceil(sum(widths_pt) / max(free_pt, max(widths_pt, default=1.0))))
    each = math.ceil(len(table.columns) / count)
    return [
        table.columns[first : first + each] for first in range(0, len(table.columns), each)
    ] or [()]


def _width_pt(table: Table, column: Column) -> float:
    words = [SMALL_PT * len(line) for line in _halves(column.heading)]
    for mean, error in (table.texts(row, column) for row in table.rows):
        below = table.spread == "interval"
        words += [SMALL_PT * (len(mean) + len(error) * (not below)), SCRIPT_PT * len(error) * below]
    return max(words) + GAP_PT


def _tabular(table: Table, columns: Sequence[Column]) -> Iterator[str]:
    heads = zip(
        ("", "method"), ("", "clips"), *(_halves(column.heading) for column in columns), strict=True
    )
    yield rf"\begin{{tabular}}{{@{{}}lr{'r' * len(columns)}@{{}}}}"
    yield r"\toprule"
    yield from (" & ".join(map(tex_escaped, head)) + r" \\" for head in heads)
    yield r"\midrule"
    for row in table.rows:
        yield from _row(table, row, columns)
    yield from (r"\bottomrule", r"\end{tabular}")


def _row(table: Table, row: MethodScores, columns: Sequence[Column]) -> Iterator[str]:
    """Yield the means, and below them their intervals; standard errors stand beside."""
    marks = rf"$^{{\mathrm{{{row.marks}}}}}$" if row.marks else ""
    texts = [table.texts(row, column) for column in columns]
    means = [
        rf"\textbf{{{mean}}}" if table.is_best(row, column) else mean
        for column, (mean, _) in zip(columns, texts, strict=True)
    ]
    errors = [tex_escaped(error) for _, error in texts]
    below = table.spread == "interval" and any(errors)
    if not below:
        means = [mean + error for mean, error in zip(means, errors, strict=True)]
    guard = "{}" if row.name.startswith(("[", "*")) else ""  # \\ would take them for its own
    yield " & ".join([guard + tex_escaped(row.name) + marks, table.clips(row), *means]) + r" \\"
    if below:
        yield (
            " & ".join(["", "", *(rf"{{\scriptsize {error.strip()}}}" for error in errors)])
            + r" \\[2pt]"
        )


def _halves(heading: str) -> tuple[str, str]:
    """Return a heading on two lines, broken at the space that makes the longer one shortest; one
    line stands below.
    """
    words = heading.split(" ")
    breaks = [(" ".join(words[:at]), " ".join(words[at:])) for at in range(len(words))]
    return min(breaks, key=lambda pair: max(map(len, pair)))


def tex_escaped(text: str) -> str:
    """Return text with the letters that LaTeX would take for commands spelled out."""
    return text.translate({ord(letter): tex for letter, tex in TEX.items()})
