"""Training recipes: TOML files that say what is learnt, from which clips, and how.

    [method]       fields of the method's dataclass
    [training]     fields of `Training`
    [[train]]      data sets as in a matrix file, any number of them
    [[validation]]

`$VARIABLES` in a data set's root are those of the environment.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from geovp_classic import registry
from geovp_classic.errors import BadData, UnknownComponent
from geovp_classic.interfaces import Dataset
from learned import methods

VARIABLE = re.compile(r"\$(\w+)|\$\{(\w+)\}")
TABLES = ("about", "method", "training", "train", "validation")


@dataclass(frozen=True)
class Training:
    """How long and on what hardware; a rate of learning rises over `warmup_steps` and falls as a cosine after it."""

    num_steps: int
    batch_size: int = 16  # examples a step and device
    seed: int = 0
    warmup_steps: int = 0
    final_rate: float = 0.0  # share of the rate that is left at the end
    clip_norm: float = 0.0  # of each network's gradient; 0 = unclipped
    average_steps: int = 0  # a running mean of the weights over so many steps is what is validated and kept; 0 = none
    validate_every: int = 200  # steps
    patience: int = 0  # validations without a better score before it stops; 0 = never
    save_every_s: float = 60.0
    num_threads: int = 0  # of torch on the CPU; 0 = torch's own choice
    accelerator: str = "auto"  # from here on as Lightning Fabric has them
    devices: int = 1
    num_nodes: int = 1
    strategy: str = "auto"
    precision: str = "32-true"

    def __post_init__(self) -> None:
        """Raise BadData for counts below one."""
        for name in ("num_steps", "batch_size", "validate_every", "devices", "num_nodes"):
            if getattr(self, name) < 1:
                raise BadData(f"training.{name} is {getattr(self, name)}, expected 1 or more")
        if self.average_steps < 0:
            raise BadData(f"training.average_steps is {self.average_steps}, expected 0 or more")

    @property
    def decisive(self) -> dict[str, Any]:
        """The fields on which the outcome depends; the others may change when a run goes on."""
        names = ["num_steps", "batch_size", "seed", "warmup_steps", "final_rate", "clip_norm", "validate_every"]
        names += ["patience", "precision", *(["average_steps"] if self.average_steps else [])]
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class Recipe:
    """A recipe, checked; its data sets are built but not read."""

    method_name: str
    method: methods.Method
    training: Training
    train: tuple[Dataset, ...]
    validation: tuple[Dataset, ...]


def load(method_name: str, file: Path, root: Path | None = None) -> Recipe:
    """The recipe of a file, or of a name such as "deepvo-small" among those that come with the package.

    `root` replaces the root of every data set that has one. Raises BadData or UnknownComponent naming the field.
    """
    content = _read(file)
    method, training = _settings(method_name, file, content)
    return Recipe(
        method_name,
        method,
        training,
        tuple(_datasets(content, "train", file, root)),
        tuple(_datasets(content, "validation", file, root)),
    )


def settings(method_name: str, file: Path) -> tuple[methods.Method, Training]:
    """What a recipe says about method and training, whether or not its data is here; errors as those of `load`."""
    return _settings(method_name, file, _read(file))


def shipped() -> list[str]:
    """The names of the recipes that come with the package, sorted."""
    folder = resources.files("learned").joinpath("configs")
    return sorted(file.name.removesuffix(".toml") for file in folder.iterdir() if file.name.endswith(".toml"))


def describe(datasets: Sequence[Dataset]) -> list[dict[str, Any]]:
    """The data sets for a model card: their settings without places on this machine, and the hash of their frames."""
    tables = [registry.describe(dataset) for dataset in datasets]
    for table, dataset in zip(tables, datasets, strict=True):
        table.pop("root", None)
        table.pop("cache", None)
        if split_hash := getattr(dataset, "split_hash", None):
            table["split_hash"] = split_hash
    return tables


def _settings(method_name: str, file: Path, content: Mapping[str, Any]) -> tuple[methods.Method, Training]:
    kind = methods.load(method_name)
    for key in content:
        if key not in TABLES:
            raise UnknownComponent(f"{file} has an unknown table {key!r}{registry.nearest(key, TABLES)}")
    return (
        registry.construct(kind, _table(content, "method"), f"{file}: method"),
        registry.construct(Training, _table(content, "training"), f"{file}: training"),
    )


def _read(file: Path) -> Mapping[str, Any]:
    source: Any = file
    if file.name in shipped():
        source = resources.files("learned").joinpath("configs", f"{file.name}.toml")
    elif not file.is_file():
        raise BadData(f"recipe {file} does not exist: give a .toml file or one of {', '.join(shipped())}")
    try:
        return tomllib.loads(source.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise BadData(f"{file} is not TOML: {problem}") from problem


def _table(content: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = content.get(key, {})
    if not isinstance(value, Mapping):
        raise BadData(f"{key} is {value!r}, expected a table [{key}]")
    return value


def _datasets(content: Mapping[str, Any], key: str, file: Path, root: Path | None) -> Iterable[Dataset]:
    tables = content.get(key)
    if not isinstance(tables, list) or not tables or not all(isinstance(table, Mapping) for table in tables):
        raise BadData(f'{file}: expected at least one [[{key}]] with a data set, such as name = "kitti"')
    for index, table in enumerate(tables):
        where = f"{file}: {key}[{index}]"
        if isinstance(given := table.get("root"), str):
            table = {**table, "root": str(root) if root is not None else _spelled(given, where)}
        yield registry.build("datasets", table, where)


def _spelled(text: str, where: str) -> str:
    """The text with the environment's values for its $VARIABLES."""
    for match in VARIABLE.finditer(text):
        name = match[1] or match[2]
        if not os.environ.get(name):
            raise BadData(f"{where}: root holds ${name}, which is not set: set it, or give --root FOLDER")
        text = text.replace(match[0], os.environ[name])
    return text
