"""Moving cars are detected with their place on the road and their velocity; parked ones are not."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from geovp_classic.dynamic_objects.detection import DynamicObjects
from geovp_classic.dynamic_objects.posed_images import PosedImages
from geovp_classic.errors import BadData
from geovp_classic.types import BoolArray

Observe = Callable[..., tuple[PosedImages, Any]]


def iou(mask: BoolArray, true: BoolArray) -> float:
    return float((mask & true).sum() / (mask | true).sum())


@pytest.mark.parametrize("velocity", [(1.2, 0.0, 5.0), (2.0, 0.0, 0.0)], ids=["ahead", "crossing"])
def test_a_car_is_detected_with_its_velocity(
    observe: Observe, velocity: tuple[float, float, float]
) -> None:
    observed, traffic = observe(velocity=velocity)
    (car,) = DynamicObjects().detect(observed)
    assert iou(car.mask, traffic.mask) > 0.7
    assert car.depth == pytest.approx(8.0, rel=0.1)
    # An error of the depth, which comes from one row of pixels, scales the velocity relative to
    # the camera, which drives at 4 m/s.
    camera = np.array([0, 0, 4.0])
    relative = (car.velocity - camera) * 8.0 / car.depth
    np.testing.assert_allclose(relative, velocity - camera, atol=0.05)


def test_two_clusters_of_evidence_are_one_car(observe: Observe) -> None:
    # At twice the camera's speed, evidence is found in two separate places of this car.
    observed, traffic = observe(velocity=(0.0, 0.0, 8.0))
    (car,) = DynamicObjects().detect(observed)
    assert iou(car.mask, traffic.mask) > 0.7


def test_a_parked_car_is_not_detected(observe: Observe) -> None:
    assert DynamicObjects().detect(observe(velocity=(0.0, 0.0, 0.0))[0]) == []


def test_the_unit_of_the_poses_makes_no_difference(observe: Observe) -> None:
    (in_metres,) = DynamicObjects().detect(observe()[0])
    (in_fathoms,) = DynamicObjects().detect(observe(unit_m=1.8288)[0])
    assert iou(in_fathoms.mask, in_metres.mask) > 0.99
    assert in_fathoms.depth * 1.8288 == pytest.approx(in_metres.depth, rel=1e-3)
    np.testing.assert_allclose(in_fathoms.velocity * 1.8288, in_metres.velocity, atol=1e-3)


def test_few_frames_are_enough_but_one_is_not(observed: PosedImages, traffic: Any) -> None:
    def recent(count: int) -> PosedImages:
        return replace(observed, images=observed.images[-count:], past=observed.past[-count:])

    (car,) = DynamicObjects().detect(recent(4))
    assert iou(car.mask, traffic.mask) > 0.7
    assert DynamicObjects().detect(recent(1)) == []
    assert DynamicObjects(steps=(12,)).detect(observed) == []  # there are ten frames


@pytest.mark.parametrize("steps", [(), (1, -2)])
def test_bad_steps_are_refused(steps: tuple[int, ...]) -> None:
    with pytest.raises(BadData, match="expected numbers of frames back"):
        DynamicObjects(steps=steps)
