"""Files of other programs: poses, calibrations and robot logs."""
