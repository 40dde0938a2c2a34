"""Training configs and the command line: messages for mistakes; training needs neither Open3D nor
pycolmap.
"""

import dataclasses
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from geovp_classic import registry
from geovp_classic.errors import GeovpError
from geovp_learned import methods, training_config, training_log
from geovp_learned.__main__ import main

CONFIG = """
[method]
num_past = 4
num_future = 4
architecture = { size_px = [64, 64], encoder_width = 0.0625, lstm_size = 8 }

[training]
num_steps = 4
batch_size = 2
validate_every = 2
num_threads = 1
accelerator = "cpu"

[[train]]
name = "kitti"
root = "$GEOVP_TEST_RECIPE_ROOT"
sequences = ["00"]
num_frames = 9
stride = 3
size_px = [64, 64]

[[validation]]
name = "kitti"
root = "$GEOVP_TEST_RECIPE_ROOT"
sequences = ["00"]
num_frames = 8
stride = 4
size_px = [64, 64]
"""


@pytest.fixture
def kitti(tmp_path: Path, build_component: Callable[[str, str], Any]) -> Path:
    """Ten frames of a street, as KITTI lays them out."""
    build_component("datasets", "kitti")
    return tmp_path


def written(folder: Path, text: str = CONFIG) -> Path:
    file = folder / "config.toml"
    file.write_text(text)
    return file


def command_of(folder: Path, kitti: Path, text: str = CONFIG) -> list[str]:
    file, out = written(folder, text), folder / "run"
    return ["train", "deepvo", str(file), "--root", str(kitti), "--out", str(out)]


def test_the_command_trains_and_resumes(
    tmp_path: Path, kitti: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = command_of(tmp_path, kitti)
    assert main([*command, "--limit-seconds", "0"]) == 1
    assert "stopped (go on with --resume) after 0 steps" in capsys.readouterr().out
    assert main(command) == 2
    assert "state.ckpt exists: give --resume" in capsys.readouterr().err
    assert main([*command, "--resume"]) == 0
    assert "finished after 4 steps" in capsys.readouterr().out
    assert sorted(file.name for file in (tmp_path / "run").iterdir()) == [
        "csv",
        "state.ckpt",
        "weights.safetensors",
    ]


VARIED = (
    CONFIG
    + """
[variants]
plain = {}
large = { method.architecture.lstm_size = 16, training.num_steps = 6 }
"""
)


def test_a_variant_changes_what_it_names_alone_and_a_seed_only_the_seed(
    tmp_path: Path, kitti: Path
) -> None:
    file = written(tmp_path, VARIED)
    plain = training_config.load("deepvo", file, kitti, "plain")
    large = training_config.load("deepvo", file, kitti, "large", seed=7)
    assert plain.method == training_config.load("deepvo", file, kitti).method
    architecture = dataclasses.replace(plain.method.architecture, lstm_size=16)
    assert large.method == dataclasses.replace(plain.method, architecture=architecture)
    assert large.training == dataclasses.replace(plain.training, num_steps=6, seed=7)


def test_a_variant_has_a_folder_of_its_own_and_its_card_its_command(
    tmp_path: Path, kitti: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    file, chosen = written(tmp_path, VARIED), ["--variant", "large", "--seed", "7"]
    assert main(["train", "deepvo", str(file), "--root", str(kitti), *chosen]) == 0
    weights = tmp_path / "runs" / "config-large-7" / "weights.safetensors"
    assert main(["card", str(weights)]) == 0
    command = f"    python -m geovp_learned train deepvo {file} --variant large --seed 7\n"
    assert f"Trained by\n\n{command}\n## Trained on" in capsys.readouterr().out


LIMITS_MB = {"toy": 1, "tiny": 8, "small": 8, "ablation": 8, "kitti": 400, "thesis": 400}


@pytest.mark.parametrize("name", training_config.shipped())
def test_every_shipped_config_is_sound(name: str, tmp_path: Path) -> None:
    """All but the data, which is not here."""
    method_name, *_, size = name.split("-")
    tables = training_config.tables(Path(name))
    method = registry.construct(methods.load(method_name), tables["method"], name)
    network = next(iter(method.build().values()))
    count = sum(parameter.numel() for parameter in network.parameters())
    assert 2 * count < 1e6 * LIMITS_MB[size]  # bytes in half precision
    complaint = ""
    try:
        training_config.load(method_name, Path(name), tmp_path)
    except GeovpError as error:
        complaint = str(error)
    assert (f"{name}.train[0]: {tmp_path} holds no folder 'sequences'" in complaint) == (
        size != "toy"
    )


def test_two_processes_learn_as_one_and_need_neither_open3d_nor_pycolmap(
    tmp_path: Path, kitti: Path
) -> None:
    """Distributed data parallel on the CPU: one log and one state, from batches of two in each of
    two processes.
    """
    both = CONFIG.replace(
        'accelerator = "cpu"', 'accelerator = "cpu"\ndevices = 2\nstrategy = "ddp"'
    )
    program = tmp_path / "program.py"
    program.write_text("""
import sys
for name in ("open3d", "pycolmap", "filterpy", "skimage", "numba", "duckdb", "torchvision"):
    sys.modules[name] = None  # imports fail
from geovp_learned.__main__ import main
sys.exit(main(sys.argv[1:]))
""")
    done = subprocess.run(
        [sys.executable, program, *command_of(tmp_path, kitti, both)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("finished after 4 steps") == 1
    rows = training_log.read(tmp_path / "run" / training_log.FILE)
    steps = [row["step"] for row in rows if "validation/score" in row]
    assert steps == [2, 4]  # of the first process alone
