"""Components and limits of a live predictor."""

from dataclasses import dataclass

from geovp_classic.depth.multiview import Multiview
from geovp_classic.errors import BadData
from geovp_classic.forecasting.selected import Selected
from geovp_classic.interfaces import Forecaster, Renderer
from geovp_classic.observation import Observer
from geovp_classic.odometry.ground_plane_scale import GroundPlane
from geovp_classic.odometry.monocular import Monocular
from geovp_classic.predictors.hindcast import Hindcast
from geovp_classic.renderers.depth_fusion import DepthFusion


@dataclass(frozen=True)
class LiveSettings:
    """Components, which are those of the batch pipeline, and when a prediction is not trusted."""

    # Its scale is replaced by `UnitSpeed` where the camera's height is unknown.
    odometry: Monocular = Monocular(GroundPlane(max_pairs=60))
    # Two ends of the past decide as four do, in half of the time.
    forecaster: Forecaster = Selected(num_cuts=2)
    # 64 planes instead of 96 take less time; with three sources instead of four, views of val
    # lose .1 dB
    renderer: Renderer = DepthFusion(Multiview(num_planes=64))
    observer: Observer = Observer()
    hindcast: Hindcast = Hindcast()
    # Frames ahead for which a prediction is compared with what was observed: half of `num_frames`,
    # as in the hindcast of a clip; the verdict is that of the last `num_tests` comparisons
    hindcast_steps: int = 5
    num_tests: int = 2
    num_frames: int = 10  # the last usable ones, which are remembered; as in the matrix `fusion`
    # Between two frames; after a longer gap, or a jump of the clock, all frames are forgotten.
    # At 10 m/s, what was within 10 m has then left the view
    max_gap_s: float = 1.0
    # With fewer since a restart, no prediction is trusted: three steps are the fewest that give
    # a mean speed and turn, and their spread
    min_frames: int = 4
    # Of the present after the last usable frame; the matrix `fusion` predicts 2 s
    max_ahead_s: float = 3.0
    min_covered: float = 0.3  # of the image; the rest is inpainted, which is then most of it
    min_tracked: float = 0.5  # of the remembered frames: most of the path is measured
    # Views are shown with a caution when they are older or less sure than this: half of the latency
    # of teleoperation over satellites, and a view of which most is doubtful
    max_sure_age_s: float = 1.0
    min_sure_confidence: float = 0.4
    path_s: float = 2.0  # of the planned path, from the present on: a driver's time to react
    path_step_s: float = 0.1  # 1 m at 10 m/s, a few pixels of the drawn path
    num_path_samples: int = 32  # whose spread is then known within 1 / sqrt(2 * 32) = 12 %
    vehicle_width_m: float = 1.8  # of a passenger car without mirrors
    min_path_depth_m: float = 0.1  # nearer points of the path are beside or behind the camera

    def __post_init__(self) -> None:
        if not 2 <= self.min_frames <= self.num_frames:
            raise BadData(
                f"streaming: min_frames {self.min_frames} and num_frames {self.num_frames}, "
                "expected 2 or more, and no more than are remembered"
            )
        # A comparison has poses before and after; a lost camera was not tracked for some frames
        min_remembered = max(self.hindcast_steps, self.odometry.tracking.max_bridged + 1)
        if self.num_frames <= min_remembered:
            raise BadData(
                f"streaming: num_frames is {self.num_frames}, expected more than {min_remembered} "
                f"for hindcast_steps {self.hindcast_steps} and max_bridged "
                f"{self.odometry.tracking.max_bridged}"
            )
