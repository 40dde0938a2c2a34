"""Evaluations without a matrix: odometry, forecasters, error budget and pose sensitivity."""
