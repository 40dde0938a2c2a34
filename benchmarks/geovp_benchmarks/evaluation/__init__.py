"""Evaluations that are commands: poses, forecasts, error budget and sensitivity.

A module exposes `add_arguments(parser)` and `run(args, progress)`, which yields the lines to print;
the first line of its docstring is its help.
"""
