"""Plain language in the packages: no banned names, and docstrings of functions open with a verb."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("geovp", "geovp_classic", "learned", "benchmarks")
BANNED_NAMES = re.compile(
    r"one|found|own|chosen|known|taken|kept|whose|every|least|most|largest|smallest|longest"
    r"|shortest|farthest|KEPT|(\w+_)?share|\w+_SHARE"
    r"|(LEAST|MOST|LARGEST|SMALLEST|LONGEST|SHORTEST|FARTHEST)_\w+"
)
BANNED_OPENINGS = re.compile(
    r"(a|an|the|this|that|these|those|its|all|each|every|no|one|only|same|what|which|whether|how"
    r"|where|when|who|if|as|at|by|for|from|in|of|on|with|without)\b",
    re.IGNORECASE,
)


def bound_names(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield (line, name) of each function, class, argument and variable."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id


def offences(source: str) -> list[str]:
    """Return the banned names and openings of docstrings in a source file, with their lines."""
    tree = ast.parse(source)
    names = [
        f"{line}: {name}"
        for line, name in bound_names(tree)
        if BANNED_NAMES.fullmatch(name.lstrip("_"))
    ]
    openings = []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            docstring = ast.get_docstring(node) or ""
            if BANNED_OPENINGS.match(docstring):
                openings.append(f"{node.lineno}: {docstring.splitlines()[0]}")
    return names + openings


@pytest.mark.parametrize("package", PACKAGES)
def test_names_and_docstrings_are_plain(package: str) -> None:
    offending = {path: offences(path.read_text()) for path in (ROOT / package).rglob("*.py")}
    assert offending
    assert not any(offending.values()), offending
