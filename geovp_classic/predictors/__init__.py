"""Frame predictors of the classical suite."""
