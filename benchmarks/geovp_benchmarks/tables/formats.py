"""Tables as Markdown, LaTeX and CSV.

LaTeX needs the packages booktabs and graphicx; a table is never wider than a column of text.
"""

import csv
import functools
import io
import math
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from geovp_benchmarks.results.store import Results
from geovp_benchmarks.statistics.score import Score
from geovp_benchmarks.tables.table_model import Table
from geovp_classic.atomic import write_bytes


def write_all(results: Results, tables: Sequence[Table]) -> None:
    """Write tables in all formats into a results folder."""
    for table in tables:
        paths = {kind: results.tables / f"{table.name}.{kind}" for kind in ("md", "tex", "csv")}
        write_bytes(paths["csv"], comma_separated(table).encode())
        # LaTeX shows the same digits as Markdown, and takes as long as all the rest.
        text = markdown(table).encode()
        is_written = all(paths[kind].exists() for kind in ("md", "tex"))
        if not is_written or paths["md"].read_bytes() != text:
            write_bytes(paths["tex"], latex(table).encode())
            write_bytes(paths["md"], text)


def markdown(table: Table, width: int | None = None) -> str:
    """Return GitHub's Markdown, aligned so that it also reads well in a terminal.

    On a terminal of so many columns, metrics that do not fit stand in blocks below.
    """
    lines = [["method", "clips", *(column.heading for column in table.columns)]]
    for row in table.rows:
        label = f"{row.label} [{row.marks}]" if row.marks else row.label
        texts = ("".join(table.texts(row, column, "**{}**")) for column in table.columns)
        lines.append([label, table.clips(row), *texts])
    notes = [f"- {note}" for note in table.notes]
    if width is not None:
        notes = [textwrap.fill(note, width, subsequent_indent="  ") for note in notes]
    return "\n".join([f"## {table.title}", *blocks(lines, width), "", *notes, ""])


def blocks(lines: Sequence[Sequence[str]], width: int | None) -> list[str]:
    """Return a grid, or several that fit a width; all have the first two columns."""
    text, size = ["", *grid(lines)], len(lines[0]) - 2
    while width is not None and size > 1 and max(map(len, text)) > width:
        size -= 1
        text = []
        for start in range(2, len(lines[0]), size):
            block = [[*line[:2], *line[start : start + size]] for line in lines]
            text += ["", *grid(block)]
    return text


def grid(lines: Sequence[Sequence[str]]) -> list[str]:
    """Return a Markdown table; all columns but the first are right-aligned."""
    left, *widths = (max(map(len, column)) for column in zip(*lines, strict=True))
    rule = ["-" * left, *(":".rjust(width, "-") for width in widths)]
    rows = (
        [first.ljust(left), *map(str.rjust, rest, widths)]
        for first, *rest in (lines[0], rule, *lines[1:])
    )
    return [f"| {' | '.join(row)} |" for row in rows]


def latex(table: Table, caption: str = "", label: str = "", max_columns: int = 5) -> str:
    """Return a `table` with caption and label; more columns continue in further ones.

    By default the caption is the table's title, and the label follows from its name. An interval
    stands below its mean. LaTeX shrinks whatever is wider than a line of the text.
    """
    return _template().render(
        table=table,
        escape=escape,
        caption=caption or escape(f"{table.title}."),
        label=label or f"tab:{table.name}",
        num_floats=max(1, -(-len(table.columns) // max_columns)),
    )


@functools.cache
def _template() -> Any:
    """Return the template of a table, in which braces are those of LaTeX."""
    import jinja2  # whose import takes as long as a query of all scores

    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        block_start_string="<%",
        block_end_string="%>",
        variable_start_string="<<",
        variable_end_string=">>",
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    return templates.get_template("table.tex")


def escape(text: str) -> str:
    """Return text in which LaTeX sees no command."""
    escaped = str.maketrans(
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
    return text.translate(escaped)


def comma_separated(table: Table) -> str:
    """Return unrounded numbers as CSV; nothing for those that are not known."""
    records = []
    for row in table.rows:
        record: dict[str, Any] = {
            "method": row.label,
            "privileged_inputs": row.marks,
            "clips": row.num_clips,
            "protocol": row.protocol,
        }
        for column in table.columns:
            score = row.scores.get(column.key) or Score(math.nan)
            record |= {
                f"{column.key}_{name}".removesuffix("_mean"): "" if math.isnan(number) else number
                for name, number in vars(score).items()
                if name not in ("values", "seeds")
            }
        records.append(record)
    names = records[0] if records else {}
    return comma_separated_lines([[*names], *([*record.values()] for record in records)])


def comma_separated_lines(lines: Iterable[Sequence[Any]]) -> str:
    """Return the cells of a grid as CSV."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(lines)
    return stream.getvalue()
