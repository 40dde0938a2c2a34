"""The results folder: protocol, methods, scores, kept predictions."""
