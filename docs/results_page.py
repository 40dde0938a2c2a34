"""Write the tables of a results folder into a page of the site.

python docs/results_page.py docs/results/stored/demo docs/results/demo.md
"""

import datetime
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables import tables
from geovp_benchmarks.tables.formats import markdown
from geovp_classic.atomic import write_bytes


def write(results: Results, page: Path, spread: str = "interval") -> None:
    """Replace the tables of a page; the opening with its commands and "## Notes" stay."""
    before = page.read_text(encoding="utf-8")
    opening = before.partition("Written on ")[0]
    notes = "## Notes" + before.partition("## Notes")[2]
    versions = ", ".join(map(" ".join, results.protocol()["versions"].items()))
    date = datetime.date.today().isoformat()
    command = ["git", "rev-parse", "--short=8", "HEAD"]
    commit = subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    lines = [
        f"{opening}Written on {date} at commit {commit} by `docs/results_page.py`; computed with "
        f"{versions}.\n"
    ]
    printed: set[str] = set()
    for table in tables.build(results, spread):
        lines.append(markdown(replace(table, notes=[n for n in table.notes if n not in printed])))
        printed.update(table.notes)
    text = "\n".join(lines).rstrip()
    write_bytes(page, f"{text}\n\n{notes}".encode())


if __name__ == "__main__":
    folder, path, *spreads = sys.argv[1:]
    write(Results(Path(folder)), Path(path), *spreads)
