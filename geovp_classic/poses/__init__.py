"""Where the camera was and will be: pose sources, odometry and forecasters."""
