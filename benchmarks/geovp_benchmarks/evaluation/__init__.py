"""Measurements of one part by itself, for `geovp study NAME`: a module or package each, found by
its name.

It exposes `add_arguments(parser)` and `run(chosen, progress)`, which yields the lines to print; the
first line of its docstring is its help.
"""
