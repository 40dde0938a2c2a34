"""Where the camera was: features, tracking, bundle adjustment, and scale from the road."""
