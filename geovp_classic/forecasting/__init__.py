"""Forecasters: future camera poses from past poses alone."""
