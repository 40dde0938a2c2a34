"""What the stochastic video predictors SVG, SRVP and SLAMP share."""
