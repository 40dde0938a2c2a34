"""Recorded poses registered to all images, past and future: the best poses that images allow."""

from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.observation import ImageStream, future_greys, observations_of, stream_needs
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.pose_refinement.registration import ImageRegistration
from geovp_classic.pose_sources.ground_truth import GroundTruth
from geovp_classic.types import Context, Motion, PrivilegedInput


@dataclass(frozen=True)
class Registered:
    """The recorded motion, adjusted to corners of the last observed frame in all other frames.

    Future images are a privileged input for poses only; renderers do not see them.
    """

    frames: ImageStream = "crop"
    registration: ImageRegistration = ImageRegistration()

    @property
    def needs(self) -> PrivilegedInput:
        """Return all poses and future images, and the uncropped frames if they are used."""
        poses = GroundTruth.needs | PrivilegedInput.FUTURE_FRAMES
        return poses | stream_needs(self.frames)

    @single_threaded_blas
    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """Return the registered motion, one sample; raise Incompatible without poses or images.

        The last observed pose stays, and so do poses of unusable frames.
        """
        recorded = GroundTruth().estimate(context)
        observed = observations_of(context, self.frames)
        past_greys = observed.greys[observed.is_usable]
        images = np.concatenate([past_greys, future_greys(context, self.frames)])
        poses = recorded.past.world_from_cam.copy()
        last = int(observed.is_usable.sum()) - 1
        adjusted = self.registration.register(
            images,
            observed.intrinsics,
            np.concatenate([poses[observed.is_usable], recorded.futures[0]]),
            reference=last,
            mask=observed.mask,
        )
        poses[observed.is_usable] = adjusted[: last + 1]
        past = replace(recorded.past, world_from_cam=poses)
        return Motion(past, adjusted[None, last + 1 :], recorded.tracked)
