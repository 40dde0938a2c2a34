"""Checks of components, of data sets, and of stored results."""
