"""The predictor that geovp uses where no other one is asked for."""

from dataclasses import dataclass
from typing import Any

from geovp_classic.forecasting.selected import Selected
from geovp_classic.interfaces import PoseSource, Renderer
from geovp_classic.odometry.monocular import Monocular
from geovp_classic.odometry.unit_scale import UnitSpeed
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.pose_sources.refined import Refined
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.predictors.hindcast import Hindcast
from geovp_classic.renderers.depth_fusion import DepthFusion


def default_pose_source(is_metric: bool) -> dict[str, Any]:
    """Return the table of refined odometry with a selected forecast, in metres or not."""
    scale = "ground-plane" if is_metric else "unit-speed"
    odometry = {"name": "monocular", "scale": {"name": scale}}
    source = {"name": "chained", "odometry": odometry, "forecaster": {"name": "selected"}}
    return {"name": "refined", "source": source, "refinements": ["registration"]}


@dataclass(frozen=True)
class Default(GeometricPredictor):
    """Geometry by refined odometry, a selected forecast and depth fusion, with its fallbacks.

    It needs no privileged input: lengths are in an unknown unit.
    """

    pose_source: PoseSource = Refined(Chained(Monocular(UnitSpeed()), Selected()))
    renderer: Renderer = DepthFusion()
    hindcast: Hindcast | None = Hindcast()
