"""Checks of results and of components."""
