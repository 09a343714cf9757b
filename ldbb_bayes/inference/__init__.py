"""Inference from readings: the posterior, its diagnostics, its evidence and its predictions."""
