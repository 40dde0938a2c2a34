"""Where the camera will be, from where it was: forecasters see poses only."""
