"""Array types, and the checks of shapes and values with which data types are constructed."""

from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt

from geovp_classic.errors import BadData

FloatArray = npt.NDArray[np.floating[Any]]
ByteArray = npt.NDArray[np.uint8]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.integer[Any]]


class ShortRepr:
    """Base class that prints the fields that are set, and arrays by their shapes."""

    def __repr__(self) -> str:
        """Return text as Trajectory(world_from_cam=[10, 4, 4], times_s=[10], is_metric=True)."""
        texts = []
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                value = list(value.shape)
            if value is not None:
                texts.append(f"{field.name}={value!r}")
        return f"{type(self).__name__}({', '.join(texts)})"


def store(owner: object, field: str, array: npt.NDArray[Any]) -> None:
    """Set a field of a frozen dataclass during construction to a read-only view of an array."""
    view = array.view()
    view.flags.writeable = False
    object.__setattr__(owner, field, view)


def store_checked(owner: object, field: str, dtype: Any, shape: tuple[int, ...]) -> None:
    """Check dtype and shape of an array field and make it read-only; skip None."""
    value = getattr(owner, field)
    if value is None:
        return
    array = np.asarray(value)
    if array.dtype != np.dtype(dtype) or array.shape != shape:
        raise BadData(
            f"{_name(owner)}: {field} is a {array.dtype} array of shape {array.shape}, expected "
            f"{np.dtype(dtype)} of shape {shape}"
        )
    store(owner, field, array)


def store_times(owner: Any, count: int | None = None) -> None:
    """Check that `times_s` [count] increases, and make it read-only."""
    times_s = np.asarray(owner.times_s, dtype=np.float64)
    expected = (times_s.size if count is None else count,)
    if times_s.shape != expected:
        raise BadData(f"{_name(owner)}: times_s has shape {times_s.shape}, expected {expected}")
    is_valid = np.isfinite(times_s)
    is_valid[1:] &= np.diff(times_s) > 0
    if not is_valid.all():
        raise BadData(
            f"{_name(owner)}: times_s must be finite and increase, but step "
            f"{np.argmin(is_valid)} does not"
        )
    store(owner, "times_s", times_s)


def store_rigid(
    owner: object,
    field: str,
    num_axes: int,
) -> None:
    """Check that a field holds rigid, finite transforms [..., 4, 4], and make it read-only."""
    name = f"{_name(owner)}: {field}"
    store(owner, field, checked_rigid(name, getattr(owner, field), num_axes))


def checked_rigid(
    name: str,
    transforms: Any,
    num_axes: int,
    tolerance: float = 1e-4,  # KITTI writes 7 digits
) -> FloatArray:
    """Return transforms [..., 4, 4] that are rigid and finite; else raise BadData."""
    poses = np.asarray(transforms, dtype=np.float64)
    if poses.ndim != num_axes or poses.shape[-2:] != (4, 4):
        raise BadData(
            f"{name} has shape {poses.shape}, expected {num_axes} axes, the last two of 4"
        )
    rotation = poses[..., :3, :3]
    is_rigid = (
        (rotation_defect(rotation) < tolerance)
        & (np.linalg.det(rotation) > 0)
        & np.isfinite(poses[..., :3, 3]).all(axis=-1)
        & (poses[..., 3, :] == [0, 0, 0, 1]).all(axis=-1)
    )
    if not is_rigid.all():
        index = np.argwhere(~is_rigid)[0].tolist()
        raise BadData(
            f"{name}: pose {index} is not rigid and finite: expected a rotation matrix, a "
            "translation and a last row 0 0 0 1"
        )
    return poses


def rotation_defect(rotation: FloatArray) -> FloatArray:
    """Return the largest entry [...] of R R' - I."""
    square = rotation @ np.swapaxes(rotation, -1, -2)
    return np.abs(square - np.eye(3)).max(axis=(-2, -1))


def take(value: Any, steps: slice | BoolArray) -> Any:
    """Return a copy of value[steps], or None; a slice of an array would lead to its other steps."""
    selected = None if value is None else value[steps]
    return selected.copy() if isinstance(selected, np.ndarray) else selected


def _name(owner: object) -> str:
    """Return the name of a clip, or else of the class."""
    return getattr(owner, "name", "") or type(owner).__name__
