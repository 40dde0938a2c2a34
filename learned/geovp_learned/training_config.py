"""Training configs: TOML files with the method, the data and the training settings.

    [method]       fields of the method's dataclass
    [training]     fields of `Training`
    [[train]]      data sets as in a matrix file, any number of them
    [[validation]]
    [variants.X]   what a variant has in place of the above, such as method.loss = "relative"

`$VARIABLES` are those of the environment.
"""

import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from geovp_classic import files, registry
from geovp_classic.errors import BadData
from geovp_classic.interfaces import Dataset
from geovp_learned import methods

FOLDER = Path(__file__).with_name("configs")


@dataclass(frozen=True)
class Training:
    """Length and hardware of a run.

    The learning rate warms up linearly, is held, and is then annealed to `final_rate` along a
    cosine or a line.
    """

    num_steps: int
    batch_size: int = 16  # examples per step and device
    seed: int = 0
    warmup_steps: int = 0
    final_rate: float = 0.0  # learning rate at the end, relative to the full one; 1 = held
    decay: Literal["cosine", "linear"] = "cosine"
    decay_steps: int = 0  # last steps in which the rate is annealed; 0 = all after the warm-up
    clip_norm: float = 0.0  # of each network's gradient; 0 = unclipped
    # The EMA of the weights over about so many steps is validated and kept; 0 = the last weights
    average_steps: int = 0
    validate_every: int = 200  # steps
    log_every: int = 20  # steps
    patience: int = 0  # validations without a better score before the run stops; 0 = unlimited
    save_every_s: float = 60.0
    num_threads: int = 0  # of torch on the CPU; 0 = torch's own choice
    num_workers: int = 0  # processes that prepare batches ahead; 0 = the training process itself
    accelerator: str = "auto"  # from here on as in Lightning Fabric
    devices: int = 1
    strategy: str = "auto"
    precision: str = "32-true"

    def __post_init__(self) -> None:
        for name in ("num_steps", "batch_size", "validate_every", "log_every"):
            if getattr(self, name) < 1:
                raise BadData(f"{name} is {getattr(self, name)}, expected 1 or more")

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
            "decay",
            "decay_steps",
            "clip_norm",
            "validate_every",
            "patience",
            "precision",
            "average_steps",
        ]
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class Tables:
    """The tables that the configs of all methods have."""

    training: Training
    train: tuple[Dataset, ...]
    validation: tuple[Dataset, ...]


@dataclass(frozen=True, kw_only=True)
class TrainingConfig(Tables):
    """A config, checked; its data sets are built but not read."""

    method_name: str
    method: methods.Method
    command: str = ""  # of the training


def load(
    method_name: str,
    file: Path,
    root: Path | None = None,
    variant: str | None = None,
    **training: Any,
) -> TrainingConfig:
    """Load the config of a file, or of the name of a shipped one such as "deepvo-small".

    `root` replaces the root of every data set that has one; `training` replaces fields of the
    table [training]. Raises BadData or UnknownComponent naming the field.
    """
    content = _merged(tables(file, root, variant), {"training": training})
    changes = training if variant is None else {"variant": variant, **training}
    options = "".join(f" --{name} {value}" for name, value in changes.items())
    kind = methods.load(method_name)
    method = registry.construct(kind, content.pop("method"), f"{file}: method")
    checked = registry.construct(Tables, content, str(file), "config")
    return TrainingConfig(
        **vars(checked),
        method_name=method_name,
        method=method,
        command=f"python -m geovp_learned train {method_name} {file}{options}",
    )


def tables(file: Path, root: Path | None = None, variant: str | None = None) -> dict[str, Any]:
    """Return the tables of a config, those of a variant merged into them; arguments as in `load`.

    Raises BadData if the file is missing, not TOML, or without the variant.
    """
    advice = f"give a .toml file or one of {', '.join(shipped())}"
    source = FOLDER / f"{file.name}.toml" if file.name in shipped() else file
    with files.checked(f"{file} is not a training config", advice):
        content = tomllib.loads(os.path.expandvars(files.read_text(source)))
        content.pop("about", None)
        variants = content.pop("variants", {})
        if variant is not None:
            if variant not in variants:
                raise ValueError(f"its variants are {', '.join(variants) or 'none'}")
            content = _merged(content, variants[variant])
        content["method"] = dict(content.get("method", {}))
        for table in (*content.get("train", []), *content.get("validation", [])):
            if root is not None and "root" in table:
                table["root"] = str(root)
    return content


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
    return sorted(file.stem for file in FOLDER.glob("*.toml"))


def describe(datasets: Sequence[Dataset]) -> list[dict[str, Any]]:
    """Return the settings of data sets without local paths, and the hash of their splits."""
    described = []
    for dataset in datasets:
        table = registry.describe(dataset)
        table.pop("root", None)
        if split_hash := getattr(dataset, "split_hash", None):
            table["split_hash"] = split_hash
        described.append(table)
    return described
