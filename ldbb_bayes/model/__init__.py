"""What we believe: terms, priors, the reduction of readings, and the hybrid model they make."""
