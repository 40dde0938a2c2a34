"""Names for kinds of arrays, and what the types check of theirs: BadData unless shape, dtype and
values are right.
"""

from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt

from geovp_classic.errors import BadData

FloatArray = npt.NDArray[np.floating[Any]]
ByteArray = npt.NDArray[np.uint8]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.integer[Any]]

RIGID_TOLERANCE = 1e-4  # KITTI writes seven digits, other tools six


class ShortRepr:
    """Prints the fields that are set, arrays by their shapes."""

    def __repr__(self) -> str:
        """As Trajectory(world_from_cam=[10, 4, 4], times_s=[10], is_metric=True)."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
        texts = {
            name: list(one.shape) if isinstance(one, np.ndarray) else one
            for name, one in values.items()
        }
        given = ", ".join(f"{name}={text!r}" for name, text in texts.items() if text is not None)
        return f"{type(self).__name__}({given})"


def store(owner: object, **values: npt.NDArray[Any]) -> None:
    """Set fields of a frozen dataclass while it is being made, read-only."""
    for field, value in values.items():
        view = value.view()
        view.flags.writeable = False
        object.__setattr__(owner, field, view)


def cut(value: Any, steps: slice | BoolArray) -> Any:
    """value[steps], or None; arrays are copied, because the base of a slice would show the other
    steps.
    """
    part = None if value is None else value[steps]
    return part.copy() if isinstance(part, np.ndarray) else part


def array_of(what: str, value: Any, kind: Any, shape: tuple[int, ...]) -> npt.NDArray[Any]:
    """An array of that kind and shape."""
    array = np.asarray(value)
    if array.dtype != np.dtype(kind) or array.shape != tuple(shape):
        raise BadData(
            f"{what}: {array.dtype} array of shape {array.shape}, expected {np.dtype(kind)} of "
            f"shape {tuple(shape)}"
        )
    return array


def times(what: str, value: Any, count: int | None) -> FloatArray:
    """Increasing times [count]; of any number for None."""
    times_s = np.asarray(value, dtype=np.float64)
    if times_s.ndim != 1 or (count is not None and len(times_s) != count):
        raise BadData(
            f"{what} has shape {times_s.shape}, expected ({'T' if count is None else count},)"
        )
    if not np.isfinite(times_s).all():
        raise BadData(f"{what}: a time is not finite: every step needs its time in seconds")
    if (np.diff(times_s) <= 0).any():
        step = int(np.argmax(np.diff(times_s) <= 0)) + 1
        raise BadData(
            f"{what}: step {step} is not later than the step before it: times must increase"
        )
    return times_s


def rigid(what: str, value: Any) -> FloatArray:
    """Rigid, finite transforms [..., 4, 4]."""
    poses = np.asarray(value, dtype=np.float64)
    if poses.ndim < 3 or poses.shape[-2:] != (4, 4):
        raise BadData(f"{what} has shape {poses.shape}, expected [..., 4, 4]")
    finite = np.isfinite(poses).all(axis=(-2, -1))
    if not finite.all():
        raise BadData(
            f"{what}: pose {_first(~finite)} has a number that is not finite: remove or mend it"
        )
    rotation = poses[..., :3, :3]
    defect = np.abs(rotation @ np.swapaxes(rotation, -1, -2) - np.eye(3)).max(axis=(-2, -1))
    good = (
        (defect < RIGID_TOLERANCE)
        & (np.linalg.det(rotation) > 0)
        & (poses[..., 3, :] == [0, 0, 0, 1]).all(-1)
    )
    if not good.all():
        raise BadData(
            f"{what}: pose {_first(~good)} is not rigid: expected a rotation matrix and a last "
            "row 0 0 0 1"
        )
    return poses


def _first(bad: Any) -> int | tuple[int, ...]:
    """The index of the first True."""
    index = tuple(np.argwhere(bad)[0].tolist())
    return index[0] if len(index) == 1 else index
