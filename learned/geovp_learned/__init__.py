"""The learned parts: the only room with torch."""
