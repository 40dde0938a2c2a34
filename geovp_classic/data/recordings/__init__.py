"""Long recordings, the clips that are cut from them, and named splits."""
