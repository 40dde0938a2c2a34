"""Layers of the last frame that the static scene does not explain."""
