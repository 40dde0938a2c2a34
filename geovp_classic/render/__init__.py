"""Scenes built from the observed frames, and how they look from elsewhere."""
