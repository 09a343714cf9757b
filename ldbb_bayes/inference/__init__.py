"""What follows: the posterior, its diagnostics and its predictions."""
