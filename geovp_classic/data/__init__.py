"""Clips from files and from the synthetic world."""
