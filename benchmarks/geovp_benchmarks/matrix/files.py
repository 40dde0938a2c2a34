"""Matrix files: located by path or built-in name, read, and changed by settings of `--set`."""

import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from geovp_benchmarks.matrix import CONFIGS, PAPERS
from geovp_classic import files
from geovp_classic.errors import BadData, UnknownComponent
from geovp_classic.registry import nearest


def locate(given: Path) -> Path:
    """Return a matrix file that is given by its path, or by the name of a built-in one."""
    for folder in (CONFIGS, PAPERS):
        built_in = folder / f"{given}.toml"
        if built_in.is_file() and not given.is_file():
            return built_in
    if not given.exists():
        names = [path.stem for folder in (CONFIGS, PAPERS) for path in folder.glob("*.toml")]
        raise BadData(
            f"{given} does not exist: give a matrix file, or the name of a built-in "
            f"one{nearest(str(given), names)}"
        )
    return given


def read(given: Path, settings: Iterable[str] = ()) -> tuple[str, dict[str, Any]]:
    """Return the name of a matrix, and the content of its file with the settings in it."""
    path = locate(given)
    files.check_name(path.stem, "the matrix")
    try:
        content = tomllib.loads(files.read_text(path))
    except (ValueError, RecursionError) as error:  # numbers of 5,000 digits are ValueErrors, too
        raise BadData(f"{path} is not TOML: {error}") from error
    _resolve_paths(content.get("protocol"), path.parent)
    for setting in settings:
        _set(content, setting)
    return path.stem, content


def _resolve_paths(protocol: Any, folder: Path) -> None:
    """Make the data set's relative paths absolute, so that stored results find it from anywhere.

    They are relative to the matrix file, or, where nothing lies there, to the working directory.
    A split is a path if it ends in .toml, else a name.
    """
    dataset = protocol.get("dataset") if isinstance(protocol, dict) else None
    names = ["root", "path", "cameras", "times", "trajectory"]
    if isinstance(dataset, dict) and str(dataset.get("split")).endswith(".toml"):
        names.append("split")
    for table, name in ((protocol, "root"), *((dataset, name) for name in names)):
        text = table.get(name) if isinstance(table, dict) else None
        if isinstance(text, str) and text and "$" not in text and text[0] != "~":
            for place in (folder / text, Path(text)):
                if isinstance(table, dict) and place.exists():
                    table[name] = str(place.absolute())
                    break


def _set(content: dict[str, Any], setting: str) -> None:
    """Set `a.b.c=VALUE` in a matrix file's content."""
    key, equals, text = setting.partition("=")
    words = [word.strip(" \"'") for word in re.findall(r"""(?:"[^"]*"|'[^']*'|[^.])+""", key)]
    if not equals or not key.strip() or not all(words):
        raise BadData(
            f"--set {setting!r} is not KEY=VALUE, such as protocol.stride=20 or "
            "'metrics.frame=[\"psnr\"]'"
        )
    table = content
    for depth, word in enumerate(words[:-1]):
        is_entry = depth == 1 and words[0] in ("pose_sources", "renderers", "predictors")
        if is_entry and word not in table:
            raise UnknownComponent(
                f"--set {setting}: [{words[0]}] has no entry {word!r}{nearest(word, table)}"
            )
        value = table.setdefault(word, {})
        if isinstance(value, str):
            value = table[word] = {"name": value}
        if not isinstance(value, dict):
            raise BadData(
                f"--set {setting}: {word} is {value!r}, which has no settings of its own: set it "
                "as a whole"
            )
        table = value
    table[words[-1]] = _value(text.strip(), setting)


def _value(text: str, setting: str) -> Any:
    """Return a value as in TOML; a bare word is a text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError) as error:
        if not text or text[0] in "\"'[{":
            raise BadData(
                f"--set {setting!r}: {text!r} is not a value as in TOML ({error})"
            ) from error
        return text
