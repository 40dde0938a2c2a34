"""One self-contained HTML page about a results folder: findings, scores, figures and films."""

import base64
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import jinja2

from geovp_benchmarks import plots
from geovp_benchmarks.analysis import confidence
from geovp_benchmarks.plots.material import Material
from geovp_benchmarks.progress import Progress, no_progress
from geovp_benchmarks.report import films, findings
from geovp_benchmarks.results.store import Method, Results
from geovp_benchmarks.results.stored_facts import MARKS, higher_is_better, summary, title
from geovp_benchmarks.tables import tables
from geovp_benchmarks.tables.table_model import EVERYTHING, Choice
from geovp_classic.data.atomic import write_bytes


def write(
    results: Results,
    progress: Progress = no_progress,
    against: str | None = None,
    choice: Choice = EVERYTHING,
) -> None:
    """Write the plots and report.html of a results folder; raise BadData without results.

    `against` names the method that all others are compared with.
    """
    protocol = results.protocol()
    scores = tables.build(results, choice=choice)
    headline = findings.Headline.of(scores[0], protocol)
    figures = [
        (page, content)
        for page, files in plots.write_all(results, progress, choice=choice)
        for path, content in files.items()
        if path.suffix == ".svg"
    ]
    html = (
        environment()
        .get_template("report.html")
        .render(
            protocol=protocol,
            summary=summary(protocol),
            methods=choice.select(results.methods()),
            findings=headline.sentences(against or "copy-last"),
            headline=headline,
            scores=scores,
            against=tables.against(results, against, choice=choice) if against else None,
            figures=figures,
            clips=films.shown_clips(Material.read(results, choice), headline),
            step_s=Material.read(results, choice).step_s,
            confidence=confidences(results),
        )
    )
    write_bytes(results.report, html.encode())


def environment() -> jinja2.Environment:
    """Return the templates of this folder, which escape all values."""
    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["base64"] = lambda content: base64.b64encode(content).decode()
    templates.filters["toml"] = settings_as_toml
    templates.filters["inputs"] = privileged_inputs
    return templates


def confidences(results: Results) -> tuple[str, list[confidence.Ranking]]:
    """Return the first frame metric and how well each method's confidence ranks its errors."""
    for name, facts in results.protocol()["metrics"].items():
        if facts["role"] == "frame" and higher_is_better(name, facts) is not None:
            return title(name), confidence.rankings(results, name)
    return "", []


def settings_as_toml(method: Method) -> str:
    """Format the resolved components as they stand in a matrix file."""
    blocks = []
    for role, settings in method.components.items():
        name = getattr(method, role, None) or method.name
        lines = [
            f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in flat(settings)
        ]
        blocks.append("\n".join([f"[{role}s.{json.dumps(name)}]", *lines]))
    return "\n\n".join(blocks)


def flat(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield nested settings as values by dotted keys."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def privileged_inputs(method: Method) -> str:
    """Name the privileged inputs of a method."""
    return ", ".join(MARKS[name][1] for name in method.privileged_inputs) or "none"
