"""Statistics of scores: intervals of means, tests of differences, strata of clips."""
