"""GeoVP: geometry-based video prediction with a moving camera; the classical suite (no torch in here)."""
