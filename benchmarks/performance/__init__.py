"""How fast things are; to be run by hand on a quiet machine, never asserted in a test."""
