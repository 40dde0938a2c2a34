"""Measure forecasters on pose files alone, and fit the ones that have constants."""
