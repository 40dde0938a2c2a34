"""Renderers: scenes reconstructed from observed frames and their poses."""
