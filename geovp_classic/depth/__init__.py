"""Inverse depth of the observed frames."""
