"""Analyses of many campaigns: batches of fits, trends of one machine, populations of machines."""

import lazy_loader

from ldbb_bayes.results import register_when_displayed

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def _load_words() -> None:
    """Load the functions with which ``print`` shows trends and populations."""
    import ldbb_bayes.fleet.population_text
    import ldbb_bayes.fleet.trend_text  # noqa: F401 - both register how results are printed


register_when_displayed(_load_words)
