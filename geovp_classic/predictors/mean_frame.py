"""The mean of the observed frames as prediction."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.types import Context, Prediction, PrivilegedInput


@dataclass(frozen=True)
class MeanFrame:
    """Prediction of the mean of all observed frames."""

    needs = PrivilegedInput.NONE

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        """Repeat the mean frame F times, as one sample."""
        mean = context.frames.mean(axis=0).round().astype(np.uint8)
        return Prediction(np.tile(mean, (1, context.num_future, 1, 1, 1)))
