"""The sequences of KITTI odometry that constants are fitted on, chosen on, and reported on."""

TRAIN = ("00", "02", "08", "09")
VAL = ("01", "04")
TEST = ("03", "05", "06", "07", "10")  # the split of DeepVO's paper
