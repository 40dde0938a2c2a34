"""Tables as LaTeX, for the packages booktabs and graphicx, never wider than a column."""

import textwrap
from pathlib import Path

import jinja2
import numpy as np

from geovp_benchmarks.tables.table_model import Column, MethodScores, Table

ESCAPED = str.maketrans(
    {
        **{sign: rf"\{sign}" for sign in "&%_#${}"},
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "|": r"\textbar{}",
        "±": r"$\pm$",
        "↑": r"$\uparrow$",
        "↓": r"$\downarrow$",
    }
)


def latex(table: Table, caption: str = "", label: str = "", max_columns: int = 5) -> str:
    """Return a `table` with caption and label; more columns continue in further ones.

    By default the caption is the table's title, and the label follows from its name. An interval
    stands below its mean. LaTeX shrinks whatever is wider than a line of the text.
    """

    def cell(method: MethodScores, column: Column) -> str:
        mean, error = table.texts(method, column, r"\textbf{{{}}}")
        if "[" not in error:
            return mean + escape(error)
        return rf"\begin{{tabular}}[t]{{@{{}}r@{{}}}}{mean}\\\scriptsize{error}\end{{tabular}}"

    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        block_start_string="<%",
        block_end_string="%>",
        variable_start_string="<<",
        variable_end_string=">>",
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["escape"] = escape
    templates.filters["lines"] = lambda text: [escape(line) for line in textwrap.wrap(text, 14)]
    num_floats = max(1, -(-len(table.columns) // max_columns))
    places = np.array_split(np.arange(len(table.columns)), num_floats)
    return templates.get_template("table.tex").render(
        table=table,
        caption=caption or escape(f"{table.title}."),
        label=label or f"tab:{table.name}",
        floats=[[table.columns[place] for place in group] for group in places],
        cell=cell,
    )


def escape(text: str) -> str:
    """Return text in which LaTeX sees no command."""
    return text.translate(ESCAPED)
