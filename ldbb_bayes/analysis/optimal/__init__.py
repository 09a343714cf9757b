"""Optimum experimental design for linear Gaussian models, free of any domain."""
