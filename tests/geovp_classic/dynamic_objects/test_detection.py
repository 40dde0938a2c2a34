"""What moves by itself is found where it is, at its place on the road and with its own velocity;
what stands is not.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from geovp_classic.dynamic_objects.detection import DynamicObject, DynamicObjects
from geovp_classic.errors import BadData
from geovp_classic.types import BoolArray

CAMERA_HEIGHT = 1.6


@pytest.fixture(scope="module")
def found(drive_behind: Callable[..., Any]) -> Callable[..., tuple[list[DynamicObject], Any]]:
    def _found(*, unit_m: float = 1.0, **street: Any) -> tuple[list[DynamicObject], Any]:
        traffic = drive_behind(unit_m=unit_m, **street)
        return find(traffic), traffic

    return _found


def find(
    traffic: Any, objects: DynamicObjects | None = None, **changed: Any
) -> list[DynamicObject]:
    street = {"images": traffic.images, "past": traffic.past, "road": traffic.road, **changed}
    camera = traffic.camera
    return (objects or DynamicObjects()).find(
        street["images"], camera, street["past"], traffic.inverse_depth, street["road"]
    )


def overlap(found: BoolArray, true: BoolArray) -> float:
    return float((found & true).sum() / (found | true).sum())


def test_a_car_ahead_is_found_with_its_velocity(found: Callable[..., Any]) -> None:
    (found_object,), traffic = found()
    assert overlap(found_object.mask, traffic.mask) > 0.7
    assert found_object.depth == pytest.approx(8.0, rel=0.1)
    # Depth comes from one row of pixels, and the velocity against the camera's 4 m/s scales with
    # it.
    relative = (found_object.velocity - [0, 0, 4.0]) * 8.0 / found_object.depth
    np.testing.assert_allclose(relative, [1.2, 0.0, 1.0], atol=0.05)


def test_a_car_that_crosses_is_found_with_its_velocity(found: Callable[..., Any]) -> None:
    (found_object,), traffic = found(velocity=(2.0, 0.0, 0.0))
    assert overlap(found_object.mask, traffic.mask) > 0.7
    relative = (found_object.velocity - [0, 0, 4.0]) * 8.0 / found_object.depth
    np.testing.assert_allclose(relative, [2.0, 0.0, -4.0], atol=0.05)


def test_two_pieces_of_evidence_are_one_car(found: Callable[..., Any]) -> None:
    # Driving away at twice the camera's speed leaves two separate patches of contradiction on this
    # car.
    objects, traffic = found(velocity=(0.0, 0.0, 8.0))
    assert len(objects) == 1
    assert overlap(objects[0].mask, traffic.mask) > 0.7


def test_what_stands_is_not_found(found: Callable[..., Any]) -> None:
    objects, _ = found(velocity=(0.0, 0.0, 0.0))
    assert objects == []


def test_any_unit_of_length_will_do(found: Callable[..., Any]) -> None:
    (in_metres,), _ = found()
    (in_fathoms,), _ = found(unit_m=1.8288)
    np.testing.assert_array_equal(in_fathoms.mask, in_metres.mask)
    assert in_fathoms.depth * 1.8288 == pytest.approx(in_metres.depth, rel=1e-6)
    np.testing.assert_allclose(in_fathoms.velocity * 1.8288, in_metres.velocity, atol=1e-3)


def test_a_change_of_exposure_moves_nothing(drive_behind: Callable[..., Any]) -> None:
    traffic = drive_behind()
    darker = (
        np.linspace(0.8, 1.0, len(traffic.images), dtype=np.float32)[:, None, None] * traffic.images
    )
    (found_object,) = find(traffic, images=darker)
    assert overlap(found_object.mask, traffic.mask) > 0.7
    still = drive_behind(velocity=(0.0, 0.0, 0.0))
    assert find(still, images=darker[:, :1, :1] / traffic.images[:, :1, :1] * still.images) == []


def test_nothing_is_found_without_a_road_or_an_earlier_frame(
    drive_behind: Callable[..., Any],
) -> None:
    traffic = drive_behind()
    assert find(traffic, road=None) == []
    assert find(traffic, images=traffic.images[-1:], past=traffic.past[-1:]) == []
    assert find(traffic, DynamicObjects(steps=(12,))) == []  # ten frames have no twelfth one


def test_an_older_frame_is_not_needed(drive_behind: Callable[..., Any]) -> None:
    traffic = drive_behind()
    (found_object,) = find(traffic, images=traffic.images[-4:], past=traffic.past[-4:])
    assert overlap(found_object.mask, traffic.mask) > 0.7


@pytest.mark.parametrize("steps", [(), (0,), (1, -2)])
def test_steps_that_go_nowhere_are_refused(steps: tuple[int, ...]) -> None:
    with pytest.raises(BadData, match="expected numbers of frames back"):
        DynamicObjects(steps=steps)
