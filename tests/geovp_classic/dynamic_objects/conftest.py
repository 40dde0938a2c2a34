"""The car that drives ahead, and what is observed of it."""

from collections.abc import Callable
from typing import Any

import pytest

from geovp_classic.dynamic_objects.segmentation import Observations


@pytest.fixture(scope="module")
def traffic(drive_behind: Callable[..., Any]) -> Any:
    return drive_behind()


@pytest.fixture(scope="module")
def observed(traffic: Any) -> Observations:
    return Observations(
        traffic.images, traffic.camera, traffic.past, traffic.inverse_depth, traffic.road
    )
