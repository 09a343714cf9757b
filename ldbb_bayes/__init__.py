"""Bayesian uncertainty quantification for the loaded double ball bar.

import ldbb_bayes as lb
campaign = lb.read_campaign("data/recovered_experiment")
posterior = lb.sample(lb.HybridModel.default(degree=1), campaign, seed=1)
print(lb.summarize(posterior))
"""

from typing import Any

import lazy_loader

__version__ = "0.2.0"

_import_public_name, _names, _public = lazy_loader.attach_stub(__name__, __file__)
__all__ = ["__version__", *_public]


def __getattr__(name: str) -> Any:
    """Return a public name; the first use also loads the words in which results print."""
    value = _import_public_name(name)
    import ldbb_bayes.report.text  # noqa: F401 - it registers how results are printed

    return value


def __dir__() -> list[str]:
    return sorted(__all__)
