"""Error budget: changes of the scores of a method when its stages are replaced by ground truth."""
