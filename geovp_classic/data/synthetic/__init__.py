"""A synthetic street: the data set that needs no download."""
