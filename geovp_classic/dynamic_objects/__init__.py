"""What moves by itself: found, segmented, its velocity measured, and rendered as sprites."""
