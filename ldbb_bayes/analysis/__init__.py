"""Analyses of posteriors and plans (campaigns without readings), such as uncertainty budgets."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
