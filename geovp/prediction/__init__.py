"""Prediction of a single clip."""
