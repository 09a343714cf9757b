"""Bayesian uncertainty quantification for the loaded double ball bar.

import ldbb_bayes as lb
campaign = lb.read_campaign("data/recovered_experiment")
posterior = lb.sample(lb.HybridModel.default(degree=1), campaign, seed=1)
print(lb.summarize(posterior))
"""

import lazy_loader

__version__ = "0.2.0"

__getattr__, _names, _public = lazy_loader.attach_stub(__name__, __file__)
__all__ = ["__version__", *_public]


def __dir__() -> list[str]:
    return sorted(__all__)
