"""Accuracy of odometries and forecasters on trajectories, without predicted frames."""
