"""The hybrid model of compliance and geometry: terms, priors, likelihood and truncation."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["terms"])
