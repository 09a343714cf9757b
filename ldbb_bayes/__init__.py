"""Bayesian uncertainty quantification for the loaded double ball bar.

import ldbb_bayes as lb
campaign = lb.read_campaign("data/recovered_experiment")
posterior = lb.sample(lb.HybridModel.default(degree=1), campaign, seed=1)
print(lb.summarize(posterior))

The model comes from the article "A Novel Elasto-Geometric Model Exploiting Loaded Circular Test on
a Machine Tool". Docstrings call this article the paper; numbers of equations and tables refer to
the paper.
"""

from difflib import get_close_matches
from typing import Any

import lazy_loader

from ldbb_bayes.deprecation import NEW_NAMES, warn_of_new_name

__version__ = "0.3.0.dev0"

_import_public_name, _names, _public = lazy_loader.attach_stub(__name__, __file__)
__all__ = ["__version__", *_public]


def __getattr__(name: str) -> Any:
    """Return the public function, class or module of this package that is named ``name``.

    The object is imported when it is first used. The first call also makes ``print`` show results
    as tables and sentences.
    """
    # The module with the results is imported only here, because it loads NumPy, which takes time.
    from ldbb_bayes.results import register_when_displayed

    register_when_displayed(_load_words)
    if name in NEW_NAMES:
        warn_of_new_name(name)
        room_name, _, renamed = NEW_NAMES[name].rpartition(".")
        if room_name:
            return getattr(_import_public_name(room_name), renamed)
        name = renamed
    if name not in _public and not name.startswith("_"):
        # Without an object in which it could look for similar names, Python adds no question of its
        # own to that of the message when it prints the error.
        raise AttributeError(_unknown_name_message(name), name=name, obj=None)
    return _import_public_name(name)


def _unknown_name_message(name: str) -> str:
    """Return the error message for an unknown name, with a similar public name if there is one."""
    similar = get_close_matches(name, _public, n=1)
    if not similar:
        return f"module 'ldbb_bayes' has no attribute {name!r}. dir(ldbb_bayes) lists its names."
    return f"module 'ldbb_bayes' has no attribute {name!r}. Did you mean {similar[0]!r}?"


def _load_words() -> None:
    """Load the functions with which ``print`` shows results as tables and sentences.

    The functions are loaded only when a result is first printed, because loading them takes time.
    """
    import ldbb_bayes.report.text  # noqa: F401 - it registers how results are printed


def __dir__() -> list[str]:
    return sorted(__all__)
