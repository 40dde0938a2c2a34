"""Predictive display: a delayed video with its predicted present, on a local page or as an mp4."""
