"""Inpainters of the pixels that a scene does not cover; covered pixels are never changed."""
