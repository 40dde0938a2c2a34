"""Layouts of data sets: which files hold images, times, cameras and poses."""
