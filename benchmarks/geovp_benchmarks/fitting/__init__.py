"""Fit the constants of forecasters to recorded poses."""
