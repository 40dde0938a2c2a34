"""The harness: matrices, runs, stored scores, tables, plots, reports and the command line."""
