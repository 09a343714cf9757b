"""Analyses of a posterior or a plan: verdicts on parameters, comparisons, previews of campaigns."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
