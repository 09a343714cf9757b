"""Analyses of a posterior or of a plan (a campaign without readings), such as verdicts."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
