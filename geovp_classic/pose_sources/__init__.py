"""Pose sources: where the camera was and will be."""
