"""Frames of one camera, read one at a time: image files or a video, and lens distortion."""
