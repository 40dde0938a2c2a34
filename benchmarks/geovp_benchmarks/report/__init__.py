"""One self-contained HTML page about a results folder: findings, scores, figures and films."""

import base64
import json
from dataclasses import replace
from pathlib import Path

import jinja2

from geovp_benchmarks import plots
from geovp_benchmarks.plots.material import Material
from geovp_benchmarks.report import browser, findings
from geovp_benchmarks.results import stored_facts
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.statistics import strata
from geovp_benchmarks.tables import tables
from geovp_classic.atomic import write_bytes


def write(results: Results, options: plots.Options) -> None:
    """Write the plots and report.html of a results folder; raise BadData without results.

    With `options.against` and `by` there are also tables of differences and of strata.
    """
    # Tables: scores, differences from a method, strata, and the findings that open the page.
    metrics, against = options.metrics, options.against
    material, baseline = Material(results, options), against or "copy-last"
    scores = tables.build(results, metrics=metrics)
    differences = tables.against(results, against, metrics=metrics) if against else None
    groups = strata.divide(results, options.by) if options.by else []
    has_baseline = any(m.label == baseline and m.num_clips for m in results.select().methods())
    gains = differences
    if has_baseline and not against:
        gains = tables.against(results, baseline, metrics=metrics)
    headline = findings.find(scores[0], gains, material.protocol, baseline)
    # Figures: those of all results, and those that the options ask for.
    plain = replace(options, by=None, against=None)
    figures = [
        (page, path.read_bytes())
        for drawn in ([plain] if options == plain else [plain, options])
        for page, paths in plots.write_all(results, drawn)
        for path in paths
        if path.suffix == ".svg"
    ]
    # The page, which contains everything that it shows.
    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["base64"] = lambda content: base64.b64encode(content).decode()
    templates.filters["json"] = lambda value: json.dumps(value, ensure_ascii=False, indent=2)
    html = templates.get_template("report.html").render(
        protocol=material.protocol,
        methods=results.methods(),
        facts=stored_facts,
        findings=headline,
        baseline=baseline,
        scores=scores,
        against=differences,
        strata=[tables.build(group, metrics=metrics)[0] for group in groups],
        figures=figures,
        browser=browser.build(material, headline),
        shown={method.label for method in material.shown},
        step_s=material.step_s,
        zip=zip,
    )
    write_bytes(results.report, html.encode())
