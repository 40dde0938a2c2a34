"""Evaluations beside the matrices: odometry, forecasters, error budget and pose sensitivity."""
