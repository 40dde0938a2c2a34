"""The training loop on a method small enough to follow: a line through brightness against time, and
a critic.
"""

import multiprocessing
import os
import signal
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from lightning.fabric import Fabric
from lightning.fabric.plugins import MixedPrecision
from torch import nn
from torch.optim import Optimizer
from torch.utils.data import DataLoader

from geovp_classic.errors import BadData
from geovp_classic.types import Clip, Intrinsics
from geovp_learned import batches, checkpoints, training, training_log
from geovp_learned.methods import Batch, Losses, Networks
from geovp_learned.stored_clips import Arrays
from geovp_learned.training import learning_rate_factor
from geovp_learned.training_config import Training, TrainingConfig


@dataclass(frozen=True)
class LineTraining:
    """Learns how bright a frame is from its time, under dropout and noise, so that random numbers
    matter.
    """

    rate: float = 0.05

    def build(self) -> dict[str, nn.Module]:
        return {
            "line": nn.Sequential(nn.Linear(1, 8), nn.Dropout(0.1), nn.Linear(8, 1)),
            "critic": nn.Linear(1, 1),
        }

    def optimisers(self, networks: Networks) -> dict[str, Optimizer]:
        line, critic = networks["line"].parameters(), networks["critic"].parameters()
        return {
            "line": torch.optim.Adam(line, self.rate),
            "critic": torch.optim.SGD(critic, 0.01, momentum=0.9),
        }

    def prepare(self, clip: Clip) -> Arrays:
        return {"times_s": clip.times_s, "frames": clip.frames}

    def examples(self, clips: Sequence[Arrays], *, training: bool) -> Sequence[tuple[float, float]]:
        return [
            (float(t), float(frame.mean() / 255))
            for clip in clips
            for t, frame in zip(clip["times_s"], clip["frames"], strict=True)
        ]

    def example(self, item: Any, rng: np.random.Generator) -> Batch:
        time_s, brightness = item
        noisy_s = time_s + rng.normal(0, 0.1)
        return {"time": torch.tensor([noisy_s]).float(), "brightness": torch.tensor([brightness])}

    def training_step(self, networks: Networks, batch: Batch, step: int) -> dict[str, Losses]:
        guess = networks["line"](batch["time"])
        seen = networks["critic"](guess.detach())
        return {
            "line": {"total": ((guess - batch["brightness"]) ** 2).mean()},
            "critic": {"total": ((seen - 1) ** 2).mean(), "seen": seen.mean()},
        }

    def validation_example(self, item: Any) -> Batch:
        time_s, brightness = item
        return {"time": torch.tensor([time_s]), "brightness": torch.tensor([brightness])}

    def validation_step(self, networks: Networks, batch: Batch) -> Losses:
        return {"score": ((networks["line"](batch["time"]) - batch["brightness"]) ** 2).mean()}


@dataclass(frozen=True)
class Fading:
    """Clips that grow brighter at a constant rate."""

    num_clips: int = 2

    @property
    def name(self) -> str:
        return "fading"

    def __len__(self) -> int:
        return self.num_clips

    def __getitem__(self, index: int) -> Clip:
        times_s = np.arange(8) / 10 + index
        levels = np.clip(100 + 50 * times_s, 0, 255).astype(np.uint8)
        frames = np.broadcast_to(levels[:, None, None, None], (8, 8, 8, 3)).copy()
        return Clip(f"fading/{index}", frames, times_s, Intrinsics(8, 8, 3.5, 3.5, 8, 8))


SETTINGS = Training(
    num_steps=60, batch_size=4, seed=3, warmup_steps=5, clip_norm=1.0, validate_every=20
)


# One process imports torch for all that are forked from it: workers, and one that is killed
FORKSERVER = multiprocessing.get_context("forkserver")
FORKSERVER.set_forkserver_preload(["geovp_learned.training"])


def described(datasets: Sequence[Fading]) -> list[dict[str, Any]]:
    return [{"name": each.name} for each in datasets]


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    """The data set has no entry point; describe it all the same."""
    monkeypatch.setattr("geovp_learned.training_config.describe", described)


def config(settings: Training = SETTINGS, method: LineTraining | None = None) -> TrainingConfig:
    return TrainingConfig(
        settings,
        train=(Fading(),),
        validation=(Fading(num_clips=1),),
        method_name="line",
        method=method or LineTraining(),
    )


def logged(folder: Path, name: str) -> list[tuple[float, float]]:
    """The steps and values of a number in the log."""
    rows = training_log.read(folder / training_log.FILE)
    return [(row["step"], row[name]) for row in rows if name in row]


def state_of(folder: Path) -> dict[str, Any]:
    return torch.load(folder / training.STATE, weights_only=True)


def tensors_of(folder: Path) -> dict[str, torch.Tensor]:
    """All tensors of the stored networks, averages and optimisers."""
    flat, _ = torch.utils._pytree.tree_flatten_with_path(state_of(folder))
    return {str(path): value for path, value in flat if isinstance(value, torch.Tensor)}


def assert_same(one: Path, other: Path) -> None:
    """Compare the last tensors of two runs, and what they logged."""
    torch.testing.assert_close(tensors_of(one), tensors_of(other), rtol=0, atol=0)
    name = "train/line.total"
    assert logged(one, name) == logged(other, name)


def train_whole_and_in_pieces(own: TrainingConfig, folder: Path) -> None:
    """Train without a break, and interrupted again and again."""
    training.train(own, folder / "whole")
    for _ in range(200):
        if training.train(own, folder / "pieces", resume=True, limit_s=0.03).is_finished:
            break


def test_it_learns_and_keeps_the_best_tensors_of(tmp_path: Path) -> None:
    outcome = training.train(config(replace(SETTINGS, num_steps=300)), tmp_path)
    scores = logged(tmp_path, "validation/score")
    assert [step for step, _ in scores] == list(range(20, 301, 20))
    assert outcome.progress.best_score == pytest.approx(min(score for _, score in scores), rel=1e-5)
    assert (
        outcome.progress.best_score < 0.01
    )  # brightness runs from 0.39 to 0.67: its variance alone is 0.01
    settings, tensors = checkpoints.read(tmp_path / training.WEIGHTS, "line", LineTraining)
    assert settings == LineTraining()
    metadata, _ = checkpoints.read_tensors(tmp_path / training.WEIGHTS)
    assert metadata["history"]["step"] == outcome.progress.best_step
    assert {name.partition(".")[0] for name in tensors} == {
        "line"
    }  # the critic only served training


def test_worker_processes_prepare_the_same_batches(tmp_path: Path) -> None:
    training.train(config(), tmp_path / "alone")
    training.train(config(replace(SETTINGS, num_workers=2)), tmp_path / "helped")
    assert_same(tmp_path / "alone", tmp_path / "helped")


def test_the_mean_of_the_weights_is_what_is_kept(tmp_path: Path) -> None:
    """Of a run that steps to and fro, the mean scores better than where it stands, and is what the
    file holds.
    """
    restless = LineTraining(rate=0.5)
    settings = replace(SETTINGS, num_steps=120, final_rate=1.0, validate_every=120)
    plain, mean = tmp_path / "plain", tmp_path / "mean"
    training.train(config(settings, restless), plain)
    training.train(config(replace(settings, average_steps=20), restless), mean)
    ((_, of_last),), ((_, of_mean),) = (logged(each, "validation/score") for each in (plain, mean))
    assert of_mean < of_last
    assert logged(mean, "train/line.total") == logged(plain, "train/line.total")  # learns the same
    _, kept = checkpoints.read_tensors(mean / training.WEIGHTS)
    bias = state_of(mean)["average"]["module.line.0.bias"]
    torch.testing.assert_close(kept["line.0.bias"].float(), bias, atol=1e-3, rtol=1e-3)
    assert not torch.allclose(state_of(mean)["network.line"]["0.bias"], bias, atol=1e-2)


def test_a_resumed_run_ends_with_the_same_weights(tmp_path: Path) -> None:
    train_whole_and_in_pieces(config(replace(SETTINGS, average_steps=10)), tmp_path)
    whole, pieces = tmp_path / "whole", tmp_path / "pieces"
    assert any("exp_avg_sq" in name for name in tensors_of(whole))
    assert_same(whole, pieces)
    best = [checkpoints.read_tensors(each / training.WEIGHTS)[1] for each in (whole, pieces)]
    torch.testing.assert_close(*best, rtol=0, atol=0)


def test_a_resumed_run_in_halves_goes_on_with_its_loss_scale(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As "16-mixed" is on a GPU; here on the CPU, with a factor that doubles every 7 good steps."""

    def halves(**given: Any) -> Fabric:
        scaler = torch.amp.GradScaler("cpu", init_scale=4.0, growth_interval=7)
        return Fabric(accelerator="cpu", plugins=[MixedPrecision("16-mixed", "cpu", scaler)])

    monkeypatch.setattr(training, "Fabric", halves)
    mixed = config(replace(SETTINGS, precision="16-mixed", accelerator="cpu"))
    train_whole_and_in_pieces(mixed, tmp_path)
    factors = [state_of(tmp_path / each)["precision"] for each in ("whole", "pieces")]
    assert factors[0] == factors[1]
    assert factors[0]["scale"] > 4.0
    assert_same(tmp_path / "whole", tmp_path / "pieces")


def train_until_killed(folder: Path) -> None:
    """Train in this process until SIGKILL ends it at the 46th step."""
    step = LineTraining.training_step

    def deadly(*given: Any) -> dict[str, Losses]:
        if given[-1] == 45:
            os.kill(os.getpid(), signal.SIGKILL)
        return step(*given)

    patch = pytest.MonkeyPatch()
    patch.setattr("geovp_learned.training_config.describe", described)
    patch.setattr(LineTraining, "training_step", deadly)
    training.train(config(replace(SETTINGS, save_every_s=0.05)), folder)


def test_a_killed_run_goes_on(tmp_path: Path) -> None:
    """SIGKILL at some step; what was logged behind the last state is taken back."""
    training.train(config(), tmp_path / "whole")
    process = FORKSERVER.Process(target=train_until_killed, args=(tmp_path / "killed",))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    training.train(config(), tmp_path / "killed", resume=True)
    assert_same(tmp_path / "whole", tmp_path / "killed")


def test_early_stopping_counts_validations_without_a_better_score(tmp_path: Path) -> None:
    still = config(replace(SETTINGS, patience=2), LineTraining(rate=0.0))
    outcome = training.train(still, tmp_path)
    assert (outcome.progress.step, outcome.progress.best_step, outcome.is_finished) == (
        60,
        20,
        True,
    )  # 20 is the best, 40 and 60 are not
    again = training.train(still, tmp_path, resume=True)
    assert again.progress.step == 60


def test_mixed_precision_computes_in_halves_but_does_not_round_what_it_is_given() -> None:
    fabric = Fabric(accelerator="cpu", precision="bf16-mixed")
    training.keep_inputs(fabric)
    given = {}

    class Keeping(nn.Linear):
        def forward(self, numbers: torch.Tensor) -> torch.Tensor:
            given["numbers"] = numbers
            given["result"] = super().forward(numbers)
            return given["result"]

    network = fabric.setup(Keeping(1, 1))
    network(torch.tensor([[489.5]]))
    assert given["numbers"].item() == 489.5  # 490 in bfloat16
    assert given["result"].dtype == torch.bfloat16


def test_a_state_of_another_run_or_a_truncated_one_is_refused(tmp_path: Path) -> None:
    training.train(config(), tmp_path)
    with pytest.raises(BadData, match="belongs to a run with another settings: give another --out"):
        training.train(config(method=LineTraining(rate=0.2)), tmp_path, resume=True)
    with pytest.raises(BadData, match="with another training"):
        training.train(config(replace(SETTINGS, seed=4)), tmp_path, resume=True)
    file = tmp_path / training.STATE
    file.write_bytes(file.read_bytes()[:-50])
    with pytest.raises(BadData, match="is not a whole training state"):
        training.train(config(), tmp_path, resume=True)


def test_the_rate_rises_and_falls() -> None:
    """Along a cosine from 1 to 0.2, or as of SRVP, along a line to 0 in the last 40 steps."""
    cosine = replace(SETTINGS, num_steps=105, warmup_steps=5, final_rate=0.2)
    factors = [learning_rate_factor(step, cosine) for step in (0, 4, 5, 55, 105)]
    assert factors == pytest.approx([0.2, 1.0, 1.0, 0.6, 0.2])
    line = replace(cosine, warmup_steps=0, final_rate=0.0, decay="linear", decay_steps=40)
    factors = [learning_rate_factor(step, line) for step in (0, 65, 75, 105)]
    assert factors == pytest.approx([1.0, 1.0, 0.75, 0.0])


@dataclass(frozen=True)
class Numbers(LineTraining):
    """Examples are numbers."""

    def example(self, item: Any, rng: np.random.Generator) -> Batch:
        return {"number": torch.tensor(item)}


@dataclass
class Rank:
    """What the loader of batches takes from Fabric."""

    global_rank: int
    world_size: int = 2
    device = torch.device("cpu")

    def setup_dataloaders(self, loader: DataLoader[Batch], **_: bool) -> DataLoader[Batch]:
        return loader


def test_every_example_comes_once_an_epoch_on_two_devices_together() -> None:
    settings = Training(num_steps=5, batch_size=2)
    loaders = [batches.loader(Numbers(), range(10), settings, 0, Rank(rank)) for rank in range(2)]
    steps = list(zip(*loaders, strict=True))
    assert len(steps) == 5
    dealt = [number for step in steps for batch in step for number in batch["number"].tolist()]
    assert sorted(dealt[:8]) != sorted(dealt[8:16])
    assert sorted(dealt) == sorted(2 * list(range(10)))  # 5 steps of 4 are two epochs
    (resumed, *_) = batches.loader(Numbers(), range(10), settings, 3, Rank(1))
    assert resumed["number"].tolist() == steps[3][1]["number"].tolist()
