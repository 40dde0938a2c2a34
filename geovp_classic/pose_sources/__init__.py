"""Pose sources: past and future camera motion."""
