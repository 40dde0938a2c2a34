"""Training configs: TOML files with the method, the data and the training settings.

    [method]       fields of the method's dataclass
    [training]     fields of `Training`
    [[train]]      data sets as in a matrix file, any number of them
    [[validation]]
    [variants.X]   what a variant has in place of the above, such as method.loss = "relative"

`$VARIABLES` in a data set's root are those of the environment.
"""

import dataclasses
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
from geovp_learned import methods

TABLES = ("about", "method", "training", "train", "validation", "variants")


@dataclass(frozen=True)
class Training:
    """Length and hardware of a run; the learning rate warms up linearly and is annealed along a
    cosine.
    """

    num_steps: int
    batch_size: int = 16  # examples per step and device
    seed: int = 0
    warmup_steps: int = 0
    final_rate: float = 0.0  # learning rate at the end, relative to the full one
    clip_norm: float = 0.0  # of each network's gradient; 0 = unclipped
    average_steps: int = (
        0  # the EMA of the weights over about so many steps is validated and kept; 0 = no EMA
    )
    validate_every: int = 200  # steps
    log_every: int = 20  # steps
    patience: int = 0  # validations without a better score before the run stops; 0 = unlimited
    save_every_s: float = 60.0
    num_threads: int = 0  # of torch on the CPU; 0 = torch's own choice
    num_workers: int = 0  # processes that prepare batches ahead; 0 = the training process itself
    accelerator: str = "auto"  # from here on as in Lightning Fabric
    devices: int = 1
    num_nodes: int = 1
    strategy: str = "auto"
    precision: str = "32-true"

    def __post_init__(self) -> None:
        methods.check_counts(
            self, "num_steps", "batch_size", "validate_every", "log_every", "devices", "num_nodes"
        )
        if self.average_steps < 0:
            raise BadData(f"average_steps is {self.average_steps}, expected 0 or more")

    @property
    def decisive(self) -> dict[str, Any]:
        """Return the fields that the result depends on; the others may change when a run is
        resumed.
        """
        names = [
            "num_steps",
            "batch_size",
            "seed",
            "warmup_steps",
            "final_rate",
            "clip_norm",
            "validate_every",
        ]
        names += ["patience", "precision", *(["average_steps"] if self.average_steps else [])]
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class Changes:
    """What a run changes about a config: one of its variants instead of what it says, and fields of
    its training.
    """

    variant: str | None = None
    seed: int | None = None
    precision: str | None = None

    @property
    def given(self) -> dict[str, Any]:
        """Return the fields that are not None, by name."""
        return {name: value for name, value in vars(self).items() if value is not None}


NO_CHANGES = Changes()


@dataclass(frozen=True)
class TrainingConfig:
    """A config, checked; its data sets are built but not read."""

    method_name: str
    method: methods.Method
    training: Training
    train: tuple[Dataset, ...]
    validation: tuple[Dataset, ...]


def load(
    method_name: str, file: Path, root: Path | None = None, changes: Changes = NO_CHANGES
) -> TrainingConfig:
    """Load the config of a file, or of the name of a shipped one such as "deepvo-small".

    `root` replaces the root of every data set that has one. Raises BadData or UnknownComponent
    naming the field.
    """
    method, training, content = settings(method_name, file, changes)
    datasets = (tuple(_datasets(content, key, file, root)) for key in ("train", "validation"))
    return TrainingConfig(method_name, method, training, *datasets)


def settings(
    method_name: str, file: Path, changes: Changes = NO_CHANGES
) -> tuple[methods.Method, Training, Mapping[str, Any]]:
    """Return the method and training of a config, and its tables, without building data sets;
    arguments and errors: `load`.
    """
    content, kinds = _read(file), {"method": methods.load(method_name), "training": Training}
    fields = changes.given
    if (variant := fields.pop("variant", None)) is not None:
        variants = content.get("variants", {})
        if variant not in variants:
            raise UnknownComponent(
                f"{file} has no variant {variant!r}: it has {', '.join(variants) or 'none'}"
            )
        content = _merged(content, variants[variant])
    for key in content:
        if key not in TABLES:
            raise UnknownComponent(
                f"{file} has an unknown table {key!r}{registry.nearest(key, TABLES)}"
            )
    for key in kinds:
        if not isinstance(content.get(key, {}), Mapping):
            raise BadData(f"{key} is {content[key]!r}, expected a table [{key}]")
    method, training = (
        registry.construct(kinds[key], content.get(key, {}), f"{file}: {key}") for key in kinds
    )
    return method, dataclasses.replace(training, **fields), content


def _merged(table: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Merge changes into a table, and in the same way into the tables in it."""
    both = {
        key: _merged(table[key], value)
        for key, value in changes.items()
        if isinstance(table.get(key), Mapping)
    }
    return {**table, **changes, **both}


def shipped() -> list[str]:
    """Return the sorted names of the configs that come with the package."""
    folder = resources.files("geovp_learned").joinpath("configs")
    return sorted(
        file.name.removesuffix(".toml") for file in folder.iterdir() if file.name.endswith(".toml")
    )


def describe(datasets: Sequence[Dataset]) -> list[dict[str, Any]]:
    """Return the settings of data sets without local paths, and the hash of their splits."""
    tables = [registry.describe(dataset) for dataset in datasets]
    for table, dataset in zip(tables, datasets, strict=True):
        table.pop("root", None)
        if split_hash := getattr(dataset, "split_hash", None):
            table["split_hash"] = split_hash
    return tables


def _read(file: Path) -> Mapping[str, Any]:
    source: Any = file
    if file.name in shipped():
        source = resources.files("geovp_learned").joinpath("configs", f"{file.name}.toml")
    elif not file.is_file():
        raise BadData(
            f"config {file} does not exist: give a .toml file or one of {', '.join(shipped())}"
        )
    try:
        return tomllib.loads(source.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise BadData(f"{file} is not TOML: {problem}") from problem


def _datasets(
    content: Mapping[str, Any], key: str, file: Path, root: Path | None
) -> Iterable[Dataset]:
    tables = content.get(key)
    if (
        not isinstance(tables, list)
        or not tables
        or not all(isinstance(table, Mapping) for table in tables)
    ):
        raise BadData(
            f'{file}: expected at least one [[{key}]] with a data set, such as name = "kitti"'
        )
    for index, table in enumerate(tables):
        where = f"{file}: {key}[{index}]"
        if isinstance(given := table.get("root"), str):
            table = {**table, "root": str(root) if root is not None else _expanded(given, where)}
        yield registry.build("datasets", table, where)


def _expanded(path: str, where: str) -> str:
    """Return the path with its environment variables replaced."""
    expanded = os.path.expandvars(path)
    if unset := re.search(r"\$\{?(\w+)", expanded):
        raise BadData(
            f"{where}: root holds ${unset[1]}, which is not set: set it, or give --root FOLDER"
        )
    return expanded
