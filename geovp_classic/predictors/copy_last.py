"""The last observed frame as prediction."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.types import Context, Prediction, PrivilegedInput


@dataclass(frozen=True)
class CopyLast:
    """Prediction of the last observed frame."""

    needs = PrivilegedInput.NONE

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        """Repeat the last frame F times, as one sample."""
        return Prediction(np.tile(context.frames[-1], (1, context.num_future, 1, 1, 1)))
