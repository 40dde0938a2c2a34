"""Layers in front of the static scene."""

from typing import NamedTuple

from geovp_classic.types.arrays import BoolArray, FloatArray


class MovingPatch(NamedTuple):
    """A flat, rigid patch that faces the last camera and moves at a constant velocity."""

    mask: BoolArray  # [H, W], in the last frame
    inverse_depth: float
    velocity_per_s: FloatArray  # [3], in the world frame and unit of the trajectory
