"""What several steps need to know about the observed frames, computed once."""
