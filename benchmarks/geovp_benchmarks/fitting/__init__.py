"""Fits of the forecasters' constants to recorded poses."""
