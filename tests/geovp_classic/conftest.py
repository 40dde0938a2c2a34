"""Every registered component, built: with its defaults, with default parts, or with the settings of this table."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from geovp_classic import registry
from geovp_classic.contracts import street
from geovp_classic.data import pose_files
from geovp_classic.errors import MissingExtra

PART_OF_PROTOCOL = {
    registry.PROTOCOL_OF_ROLE["pose_sources"]: "ground-truth",
    registry.PROTOCOL_OF_ROLE["odometries"]: "ground-truth",
    registry.PROTOCOL_OF_ROLE["forecasters"]: "constant-turn",
    registry.PROTOCOL_OF_ROLE["depth_sources"]: "given",
    registry.PROTOCOL_OF_ROLE["renderers"]: "given-depth",
}
SETTINGS: dict[tuple[str, str], dict[str, Any]] = {
    ("pose_sources", "commanded"): {"speed_m_s": 5.0, "turn_deg_s": 3.0},
    ("datasets", "synthetic"): {"num_clips": 1, "num_frames": 2, "size_px": [32, 32]},
    ("executors", "dask"): {"address": "tcp://127.0.0.1:8786"},
}


@pytest.fixture
def build_component(tmp_path: Path) -> Callable[[str, str], Any]:
    """Build a component of a role by name; the test is skipped when an extra or weights are missing."""

    def build(role: str, name: str) -> Any:
        try:
            kind = registry.load(role, name)
            settings = {"name": name, **SETTINGS.get((role, name), {}), **_on_disk(role, name, tmp_path)}
            for field, part in _parts(kind).items():
                settings.setdefault(field, part)
            return registry.build(role, settings)
        except MissingExtra as missing:
            pytest.skip(str(missing))

    return build


def _parts(kind: type) -> dict[str, str]:
    """Default parts for the required fields that are components."""
    hints = typing.get_type_hints(kind)
    required = [
        field.name
        for field in dataclasses.fields(kind)
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    ]
    return {name: PART_OF_PROTOCOL[hints[name]] for name in required if hints[name] in PART_OF_PROTOCOL}


def _on_disk(role: str, name: str, folder: Path) -> dict[str, Any]:
    """Settings that name files, once these are written."""
    if (role, name) == ("predictors", "recorded"):
        file = folder / f"{street.clip().name}.npz"
        file.parent.mkdir(parents=True)
        np.savez(file, frames=street.clip().frames[6:])
        return {"path": str(folder)}
    if (role, name) == ("datasets", "synthetic"):
        return {"cache": str(folder)}
    if (role, name) in (("datasets", "kitti"), ("datasets", "folder")):
        _write_kitti(folder)
        images = {"path": str(folder / "sequences" / "00" / "image_2"), "intrinsics": [150.0, 150.0, 63.5, 63.5]}
        return {**({"root": str(folder)} if name == "kitti" else images), "num_frames": 3, "size_px": [32, 32]}
    return {}


def _write_kitti(root: Path) -> None:
    """The contracts' street as a sequence of KITTI odometry."""
    clip, sequence = street.clip(), root / "sequences" / "00"
    (sequence / "image_2").mkdir(parents=True)
    for step, frame in enumerate(clip.frames):
        cv2.imwrite(str(sequence / "image_2" / f"{step:06d}.png"), frame[..., ::-1])
    projection = " ".join(map(str, np.column_stack([clip.intrinsics.matrix, np.zeros(3)]).ravel()))
    (sequence / "calib.txt").write_text("".join(f"P{camera}: {projection}\n" for camera in range(4)))
    np.savetxt(sequence / "times.txt", clip.times_s)
    (root / "poses").mkdir()
    pose_files.write_kitti(root / "poses" / "00.txt", clip.trajectory)
