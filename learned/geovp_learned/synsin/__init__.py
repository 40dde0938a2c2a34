"""SynSin (Wiles et al. 2020): one frame becomes a cloud of features, which is splatted and refined
into new views.
"""
