"""Logs of a training run: a CSV file, and TensorBoard and wandb where they are installed."""

import csv
import os
from importlib.util import find_spec
from pathlib import Path

from lightning.fabric.loggers.csv_logs import CSVLogger
from lightning.fabric.loggers.logger import Logger
from lightning.fabric.loggers.tensorboard import TensorBoardLogger

FILE = Path("csv", "metrics.csv")  # in the folder of a run


def loggers(folder: Path, step: int) -> list[Logger]:
    """Return the loggers of a run that goes on from a step; later rows are removed."""
    file = folder / FILE
    rows = read(file) if file.is_file() else []
    file.unlink(missing_ok=True)
    csv_logger = CSVLogger(folder, name=FILE.parent.name, version="")
    for row in rows:
        row_step = int(row.pop("step"))
        if row_step <= step:
            csv_logger.log_metrics(dict(row), row_step)
    csv_logger.save()
    more: list[Logger] = []
    if find_spec("tensorboard"):
        more.append(TensorBoardLogger(folder, name="tensorboard", version=""))
    if find_spec("wandb"):
        from lightning.pytorch.loggers import WandbLogger  # importing it takes seconds

        # offline unless WANDB_MODE says otherwise: nothing is uploaded unasked
        is_offline = os.environ.get("WANDB_MODE", "offline") != "online"
        name = folder.resolve().name
        more.append(WandbLogger(name=name, save_dir=folder, id=name, offline=is_offline))
    return [csv_logger, *more]


def read(file: Path) -> list[dict[str, float]]:
    """Read the rows of a CSV file, each with its own columns, without a truncated last one."""
    with file.open(newline="") as lines:
        rows = [
            {name: float(value) for name, value in row.items() if value}
            for row in csv.DictReader(lines)
        ]
    return [row for row in rows if "step" in row]
