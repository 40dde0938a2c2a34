"""SVG: stochastic video generation with a learned prior (Denton and Fergus 2018)."""
