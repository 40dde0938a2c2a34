"""Figures, film strips and videos."""
