"""The hybrid model of compliance and geometry: terms, priors, likelihood and truncation."""
