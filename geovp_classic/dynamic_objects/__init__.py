"""Dynamic objects: detected, segmented, their velocity measured, and rendered as sprites."""
