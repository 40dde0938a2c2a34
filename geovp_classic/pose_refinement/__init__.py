"""Pose refinement from the images, between a pose source and a renderer."""
