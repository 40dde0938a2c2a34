"""Recompute the results pages by the commands that they print.

KITTI=... POSES=... VIDEOS=... python docs/recompute.py [PAGE ...]

Outputs are written to results/pages. A command whose output for this commit is stored is skipped,
so that an interrupted run goes on where it ended. Commands that train networks are left out.
"""

import datetime
import hashlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from geovp.provenance import versions

PAGES = Path("docs/results")
STORED = PAGES / "stored"
OUTPUTS = Path("results/pages")
FOLDERS = {"path/to/kitti": "KITTI", "path/to/poses": "POSES", "path/to/videos": "VIDEOS"}
OWN_COMMANDS = ("geovp ", "python benchmarks/studies ", "PYTHONPATH=benchmarks python ")


def commands(page: Path) -> list[str]:
    """Return the commands of a page that compute or print results."""
    fences = re.findall(r"^```sh\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)
    return [
        line for fence in fences for line in fence.splitlines() if line.startswith(OWN_COMMANDS)
    ]


def expected_hours() -> dict[str, float]:
    """Return the expected hours of each page, from the table of the page of results."""
    index = (PAGES / "index.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \[.*?\]\((\S+)\.md\) \|.*\| ([\d.]+) \|$", index, re.M)
    return {name: float(hours) for name, hours in rows}


def output_of(page: str, command: str, commit: str) -> Path:
    """Return the file of a command's output."""
    digest = hashlib.sha256(f"{commit} {command}".encode()).hexdigest()[:8]
    return OUTPUTS / page / f"{digest}.txt"


def missing_folders(command: str) -> list[str]:
    """Return the variables of the data that a command needs and that are not set."""
    words = shlex.split(command)
    return [name for path, name in FOLDERS.items() if path in words and not os.environ.get(name)]


def compute(command: str, output: Path, commit: str) -> bool:
    """Run a command and store what it prints; return whether it succeeded."""
    folders = {path: os.environ.get(name, "") for path, name in FOLDERS.items()}
    runnable = shlex.join(folders.get(word, word) for word in shlex.split(command))
    if re.match(r"geovp (run|reproduce) ", runnable):
        runnable += " --fresh"  # scores of other versions do not count
    begin_s = time.monotonic()
    ended = subprocess.run(runnable, shell=True, stdout=subprocess.PIPE, text=True)
    if ended.returncode not in (0, 1):  # 1: a method was skipped, and the output says so
        return False
    today, seconds = datetime.date.today().isoformat(), time.monotonic() - begin_s
    machine = ", ".join(map(" ".join, versions().items()))
    heading = (
        f"$ {command}\nComputed on {today} by commit {commit} in {seconds:.0f} s; "
        f"{os.cpu_count()} cores, {machine}.\n"
    )
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(f"{heading}\n{ended.stdout}", encoding="utf-8")
    return True


def store(name: str, printed: Sequence[str]) -> None:
    """Replace the stored scores of a matrix, and the tables of its page."""
    new = OUTPUTS / "stored" / name
    shutil.rmtree(new, ignore_errors=True)
    merge = ["geovp", "merge", str(new), f"results/{name}", "--compact", "--quiet"]
    subprocess.run(merge, check=True)
    shutil.rmtree(STORED / name)
    shutil.move(new, STORED / name)
    spread = re.findall(r"--spread (\S+)", " ".join(printed))
    page = [str(STORED / name), str(PAGES / f"{name}.md"), *spread]
    subprocess.run([sys.executable, "docs/results_page.py", *page], check=True)


def main(pages: Sequence[str]) -> int:
    """Recompute pages, the quickest first; return the exit code."""
    commit = subprocess.check_output(["git", "rev-parse", "--short", "HEAD"], text=True).strip()
    hours = expected_hours()
    if unknown := [page for page in pages if page not in hours]:
        print(f"{unknown[0]} is no results page with commands: known are {', '.join(hours)}")
        return 2
    left = sorted(pages or hours, key=hours.__getitem__)
    print(f"expected: {sum(hours[page] for page in left):.1f} hours for {', '.join(left)}")
    failed = []
    for page in left:
        for command in (printed := commands(PAGES / f"{page}.md")):
            output = output_of(page, command, commit)
            if missing := missing_folders(command):
                print(f"{page}: set {' and '.join(missing)} for: {command}")
                failed.append(page)
            elif not output.exists():
                print(f"{page}, about {hours[page]:.1f} hours: {command}", flush=True)
                if not compute(command, output, commit):
                    failed.append(page)
        texts = [path.read_text(encoding="utf-8") for path in (OUTPUTS / page).glob("*.txt")]
        if any("| unavailable" in text for text in texts):
            print(f"{page}: LPIPS is unavailable: set GEOVP_LPIPS_WEIGHTS, delete {OUTPUTS / page}")
            failed.append(page)
        if page not in failed and (STORED / page).exists():
            store(page, printed)
        print(f"{page}: outputs in {OUTPUTS / page}", flush=True)
    print(f"not complete: {', '.join(dict.fromkeys(failed)) or 'none'}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
