"""A synthetic street: the data set that needs no download."""

from geovp_classic.data.synthetic.dataset import Synthetic

__all__ = ["Synthetic"]
