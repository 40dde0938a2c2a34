"""Scenes reconstructed from the observed frames, and their rendering from other poses."""
