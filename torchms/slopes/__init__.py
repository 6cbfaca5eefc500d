"""Statistics of slopes, in NumPy: those of height maps, their moments in bins, and mixtures of Gaussians that follow them."""
