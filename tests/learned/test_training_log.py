"""The logs of a run: which loggers there are, and that nothing is uploaded unasked."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from lightning.pytorch import loggers

from geovp_learned import training_log


@pytest.mark.parametrize(("mode", "is_offline"), [(None, True), ("online", False)])
def test_wandb_is_offline_unless_it_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: str | None, is_offline: bool
) -> None:
    started: list[dict[str, Any]] = []

    class Recorder:
        def __init__(self, **settings: Any) -> None:
            started.append(settings)

    monkeypatch.setattr(loggers, "WandbLogger", Recorder)
    monkeypatch.setattr(training_log, "find_spec", lambda name: name == "wandb" or find_spec(name))
    monkeypatch.delenv("WANDB_MODE", raising=False)
    if mode is not None:
        monkeypatch.setenv("WANDB_MODE", mode)
    folder = tmp_path / "svg-kitti"
    assert isinstance(training_log.loggers(folder, 0)[-1], Recorder)
    (settings,) = started
    assert (settings["offline"], settings["id"]) == (is_offline, "svg-kitti")


def test_rows_after_the_step_of_a_resumed_run_are_removed(tmp_path: Path) -> None:
    first = training_log.loggers(tmp_path, 0)[0]
    for step in (20, 40, 60):
        first.log_metrics({"train/total": step / 10}, step)
    first.save()
    training_log.loggers(tmp_path, 40)[0].save()
    rows = training_log.read(tmp_path / training_log.FILE)
    assert [(row["step"], row["train/total"]) for row in rows] == [(20, 2.0), (40, 4.0)]
