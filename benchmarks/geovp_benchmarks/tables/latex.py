"""Tables as LaTeX, for the packages booktabs and graphicx, never wider than the text."""

import textwrap
from collections.abc import Sequence

import numpy as np

from geovp_benchmarks.tables.table_model import Column, Table


def latex(table: Table, max_columns: int = 5) -> str:
    """Return a `table` with caption and label; more columns continue in further ones.

    An interval stands below its mean. LaTeX shrinks whatever is wider than the text.
    """
    caption = table.caption or escape(f"{table.title}.")
    head = rf"\caption{{{caption}}}\label{{{table.label or f'tab:{table.name}'}}}"
    notes = [escape(note) + r"\par" for note in table.notes]
    num_floats = max(1, -(-len(table.columns) // max_columns))
    lines = []
    for places in np.array_split(np.arange(len(table.columns)), num_floats):
        lines += [r"\begin{table}", r"\centering", head, r"\small\setlength{\tabcolsep}{4pt}"]
        lines += [r"\sbox0{%", *_tabular(table, [table.columns[place] for place in places]), "}%"]
        lines += [r"\ifdim\wd0>\textwidth\resizebox{\textwidth}{!}{\usebox0}\else\usebox0\fi"]
        lines += [r"\end{table}"]
        head = rf"\addtocounter{{table}}{{-1}}\caption[]{{{caption} (Continued.)}}"
    lines[-1:] = [
        r"\par\medskip",
        r"\begin{minipage}{\textwidth}\scriptsize\raggedright",
        *notes,
        r"\end{minipage}",
        r"\end{table}",
        "",
    ]
    return "\n".join(lines)


def escape(text: str) -> str:
    """Return text in which LaTeX sees no command."""
    names = {"\\": "backslash", "~": "asciitilde", "^": "asciicircum", "<": "less", ">": "greater"}
    signs = {sign: rf"\text{name}{{}}" for sign, name in {**names, "|": "bar"}.items()}
    signs |= {"±": r"$\pm$", "↑": r"$\uparrow$", "↓": r"$\downarrow$"}
    signs |= {sign: f"\\{sign}" for sign in "&%_#${}"}
    return "".join(signs.get(letter, letter) for letter in text)


def _tabular(table: Table, columns: Sequence[Column]) -> list[str]:
    """Return the lines of the environment; long headings have several lines."""
    headings = ["method", "clips"]
    for column in columns:
        words = r"\\".join(escape(line) for line in textwrap.wrap(column.heading, 14))
        headings.append(rf"\shortstack[r]{{{words}}}")
    lines = [rf"\begin{{tabular}}{{@{{}}lr{'r' * len(columns)}@{{}}}}", r"\toprule"]
    lines += [" & ".join(headings) + r" \\", r"\midrule"]
    for method in table.methods:
        marks = rf"$^{{\mathrm{{{method.marks}}}}}$" if method.marks else ""
        guard = "{}" if method.label.startswith(("[", "*")) else ""  # not an argument of \\
        texts = [guard + escape(method.label) + marks, table.clips(method)]
        for column in columns:
            mean, error = table.texts(method, column, r"\textbf{{{}}}")
            below = rf"\begin{{tabular}}[t]{{@{{}}r@{{}}}}{mean}\\\scriptsize{error}\end{{tabular}}"
            texts.append(below if "[" in error else mean + escape(error))
        lines.append(" & ".join(texts) + r" \\")
    return [*lines, r"\bottomrule", r"\end{tabular}"]
