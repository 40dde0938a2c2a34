"""Refined motion: a pose source, and corrections of its poses one after the other."""

from dataclasses import dataclass

from geovp_classic.interfaces import PoseRefinement, PoseSource
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.pose_refinement.registration import Registration
from geovp_classic.types import Context, Motion, PrivilegedInput


@dataclass(frozen=True)
class Refined:
    """A pose source and its refinements."""

    source: PoseSource
    refinements: tuple[PoseRefinement, ...] = (Registration(),)

    @property
    def needs(self) -> PrivilegedInput:
        """Return the inputs of the source and the refinements."""
        needs = self.source.needs
        for refinement in self.refinements:
            needs |= refinement.needs
        return needs

    @single_threaded_blas
    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """Return the refined motion."""
        motion = self.source.estimate(context.only(self.source.needs), num_samples)
        for refinement in self.refinements:
            motion = refinement.refine(context.only(refinement.needs), motion)
        return motion
