"""The car that drives ahead, and how it is observed."""

from collections.abc import Callable
from typing import Any

import pytest

from geovp_classic.dynamic_objects.posed_images import PosedImages


@pytest.fixture(scope="session")
def observe(drive_behind: Callable[..., Any]) -> Callable[..., tuple[PosedImages, Any]]:
    """Return a function from the car's velocity to posed images and ground truth."""

    def _observe(**street: Any) -> tuple[PosedImages, Any]:
        traffic = drive_behind(**street)
        observed = PosedImages(
            traffic.images,
            traffic.camera,
            traffic.past,
            traffic.inverse_depth,
            traffic.road,
            steps=(1, 2, 3),
        )
        return observed, traffic

    return _observe


@pytest.fixture(scope="module")
def traffic(drive_behind: Callable[..., Any]) -> Any:
    return drive_behind()


@pytest.fixture(scope="module")
def observed(observe: Callable[..., Any]) -> PosedImages:
    return observe()[0]
