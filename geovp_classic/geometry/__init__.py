"""Where cameras are and how points become pixels, in float64."""
