"""Renderers that begin with a depth source: what they ask for, and what they do with poses that pictures contradict."""

from dataclasses import dataclass, field

import numpy as np

from geovp_classic import registry
from geovp_classic.depth.multiview import Multiview
from geovp_classic.depth.stereo import Stereo
from geovp_classic.depth_renderers import DepthFusion, Steered
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Grant, Intrinsics, Views

CAMERA = Intrinsics(60, 60, 31.5, 23.5, 64, 48)


@dataclass
class Recording:
    """A scene that notes where it was seen from."""

    asked: list[FloatArray] = field(default_factory=list)

    def view(self, world_from_cam: FloatArray, intrinsics: Intrinsics) -> Views:
        self.asked.append(world_from_cam)
        count = len(world_from_cam)
        nothing = np.zeros((count, 48, 64))
        return Views(np.zeros((count, 48, 64, 3), np.uint8), nothing > 0, nothing.astype(np.float32))


def test_no_field_is_needed() -> None:
    assert registry.build("renderers", {"name": "depth-fusion"}) == DepthFusion(Multiview())
    assert DepthFusion().needs == Grant.NONE
    assert DepthFusion(Stereo()).needs == Grant.RIGHT_FRAMES


def test_translations_are_turned_and_rotations_kept() -> None:
    scene = Recording()
    world_from_reference = se3.exp(np.array([3.0, 0, 5, 0, 0.4, 0]))
    quarter = se3.exp(np.array([0, 0, 0, 0, np.pi / 2, 0]))[:3, :3]  # z to x
    ahead = se3.exp(np.array([[0, 0, 2.0, 0, 0, 0], [0, 0, 2.0, 0, 0.1, 0]]))
    Steered(scene, world_from_reference, quarter).view(world_from_reference @ ahead, CAMERA)
    seen = se3.inverse(world_from_reference) @ scene.asked[0]
    np.testing.assert_allclose(seen[0, :3, 3], [2, 0, 0], atol=1e-12)
    np.testing.assert_allclose(seen[:, :3, :3], ahead[:, :3, :3], atol=1e-12)
