"""Matrix files: found by their path or a built-in one's name, read, and changed by what `--set`
says.
"""

import copy
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from geovp_benchmarks.cli.arguments import CONFIGS
from geovp_classic import files
from geovp_classic.errors import BadData, UnknownComponent
from geovp_classic.registry import nearest

ENTRIES = ("pose_sources", "renderers", "predictors")  # tables of named components


def locate(given: Path) -> Path:
    """The file itself, or the built-in one of that name; BadData says the nearest name when there
    is neither.
    """
    built_in = {path.stem: path for path in CONFIGS.glob("*.toml")}
    if given.is_file() or (str(given) not in built_in and given.exists()):
        return given
    if str(given) in built_in:
        return built_in[str(given)]
    if given.suffix or len(given.parts) > 1:
        raise BadData(
            f"{given} does not exist: give a matrix file, or the name of a built-in one such as "
            "demo"
        )
    raise BadData(f"no matrix file is called {str(given)!r}{nearest(str(given), built_in)}")


def read(given: Path, settings: Iterable[str] = ()) -> tuple[str, dict[str, Any]]:
    """The name of a matrix and its file's content with the settings in it; BadData when one of them
    is not TOML.
    """
    path = locate(given)
    files.check_name(path.stem, "the matrix")
    try:
        content = tomllib.loads(files.read_text(path))
    except (
        ValueError,
        RecursionError,
    ) as error:  # TOMLDecodeError is a ValueError, 5,000 digits are another
        raise BadData(f"{path} is not TOML: {error}") from error
    return path.stem, changed(content, settings)


def changed(content: dict[str, Any], settings: Iterable[str]) -> dict[str, Any]:
    """The content of a matrix file in which `a.b.c=VALUE` is set, as if it stood there."""
    content = copy.deepcopy(content)
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key.strip():
            raise BadData(
                f"--set {setting!r} is not KEY=VALUE, such as protocol.stride=20 or "
                "'metrics.frame=[\"psnr\"]'"
            )
        *above, last = _words(key.strip())
        table = content
        for depth, word in enumerate(above):
            table = _below(table, word, entry_of=above[0] if depth == 1 else "", setting=setting)
        table[last] = _value(text.strip(), setting)
    return content


def _words(key: str) -> list[str]:
    """The words of a dotted key; names such as vo+prior need no quotes here."""
    try:
        found: Any = tomllib.loads(f"{key} = 0")
    except tomllib.TOMLDecodeError:
        return key.split(".")
    words = []
    while isinstance(found, dict):
        [(word, found)] = found.items()
        words.append(word)
    return words


def _below(table: dict[str, Any], word: str, entry_of: str, setting: str) -> dict[str, Any]:
    """The table under a word, made where there is none; a component that is only named becomes a
    table.
    """
    if entry_of in ENTRIES and word not in table:
        raise UnknownComponent(
            f"--set {setting}: [{entry_of}] has no entry {word!r}{nearest(word, table)}"
        )
    here = table.setdefault(word, {})
    if isinstance(here, str):
        here = table[word] = {"name": here}
    if not isinstance(here, dict):
        raise BadData(
            f"--set {setting}: {word} is {here!r}, which has no settings of its own: set it as "
            "a whole"
        )
    return here


def _value(text: str, setting: str) -> Any:
    """A value as in TOML; a bare word is a text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError) as error:
        if not text or text[0] in "\"'[{":
            raise BadData(
                f"--set {setting!r}: {text!r} is not a value as in TOML ({error})"
            ) from error
        return text
