"""SLAMP: stochastic latent appearance and motion prediction (Akan et al. 2021)."""
