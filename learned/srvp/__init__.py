"""SRVP: stochastic latent residual video prediction (Franceschi et al. 2020)."""
