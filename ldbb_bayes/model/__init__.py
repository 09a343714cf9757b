"""Hybrid model of compliance and geometry: terms, priors, likelihood and truncation.

Each term describes a nuisance, which is an effect on the readings that is modelled but not of
interest. Some compliances cannot be negative, by the laws of physics; truncation excludes negative
values of these compliances.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["terms"])
