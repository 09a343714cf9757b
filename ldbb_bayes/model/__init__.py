"""Hybrid model of compliance and geometry: terms, priors, likelihood and truncation.

Terms (nuisance terms) are effects on the readings that are modelled but not of interest. Truncation
restricts compliances that cannot be negative to values of at least zero.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["terms"])
