"""How far away the observed pixels are: inverse depth of the observed frames."""
