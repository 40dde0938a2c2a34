"""Scores of predictions, one number per future step."""
