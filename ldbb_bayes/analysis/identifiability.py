"""Which numbers come from the readings, which from the prior, and which are two names for one thing.

The confounding fraction of a nuisance term g is 1 − Var(β | y, φ, g) / Var(β | y, φ): the share of a parameter's variance that
would vanish if the term were known.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ldbb_bayes.inference.origin import bound_of, draws_of
from ldbb_bayes.model.aliases import exact_aliases
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.terms import Columns
from ldbb_bayes.notebook import table_html

__all__ = ["Verdict", "confounding_fractions", "verdicts"]

Array = NDArray[Any]
Word = Literal["identified", "prior-limited", "aliased"]

_ALIASED = 0.5
_CONTRACTED = 0.5
_NAMED = 0.05


@dataclass(frozen=True)
class Verdict:
    """What is known of one parameter.

    The rule: aliased, when a nuisance term that looks exactly like it (together with other parameters) holds more than half of
    its variance, or is left out of the model (then nothing bounds it); else prior-limited, when its posterior sd is more than
    half of its prior sd, truncation included; else identified. Terms that look exactly like it are named all the same.

    Attributes
    ----------
    word : {"identified", "prior-limited", "aliased"}
    partners : tuple of str
        Terms that look exactly like it, the heaviest first; those with less than 5 % of its variance are not listed.
    contraction : float
        1 − posterior sd / prior sd, truncation included in both; 1 when the prior is flat.
    confounding : dict of term to fraction
    """

    word: Word
    partners: tuple[str, ...]
    contraction: float
    confounding: dict[str, float]

    def _repr_html_(self) -> str:
        rows = [{"nuisance term": term, "share of the variance": share} for term, share in self.confounding.items()]
        return table_html(f"{self.text}; contraction {self.contraction:.2f}", rows)

    @property
    def text(self) -> str:
        """The verdict in words, with the share of the variance that every partner holds."""
        if self.word == "aliased":
            return "aliased with " + " and ".join(f"{_words(term)} ({self._share(term)})" for term in self.partners)
        words = {"identified": "known from the readings", "prior-limited": "mostly the prior"}[self.word]
        named = ", ".join(f"{_words(term)} {self._share(term)}" for term in self.partners)
        return f"{words} ({named})" if named else words

    def _share(self, term: str) -> str:
        return f"{100.0 * self.confounding[term]:.0f} %" if term in self.confounding else "left out"


def confounding_fractions(bound: BoundModel, phi: Array) -> dict[str, dict[str, float]]:
    """Confounding fraction of every shared nuisance term for every parameter, at one φ (h,) [mm]; truncation aside."""
    _, conditional = bound.collapsed.conditional(phi[None], np.zeros(len(bound.names)))
    precision = conditional.precision_root[0] @ conditional.precision_root[0].T
    names = bound.collapsed.shared_names
    own = np.arange(len(names) - len(bound.names), len(names))
    every = _variances(precision, np.arange(len(names)), own)
    fractions: dict[str, dict[str, float]] = {name: {} for name in bound.names}
    for term in bound.model.nuisances:
        columns = [c for c in term.columns(bound.setting) if isinstance(c, Columns) and not c.private]
        members = {name for c in columns for name in c.names}
        if not members:
            continue
        free = np.array([i for i, name in enumerate(names) if name not in members])
        known = _variances(precision, free, own)
        for name, fraction in zip(bound.names, 1.0 - known / every, strict=True):
            fractions[name][type(term).__name__] = float(np.clip(fraction, 0.0, 1.0))
    return fractions


def verdicts(posterior: xr.DataTree) -> dict[str, Verdict]:
    """A verdict on every parameter of interest of a posterior."""
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound)
    fractions = confounding_fractions(bound, phi.mean(axis=0))
    alike: dict[str, set[str]] = {name: set() for name in bound.names}
    unbounded: dict[str, set[str]] = {name: set() for name in bound.names}
    for alias in exact_aliases(bound):
        for name in alias.parameters:
            (alike if alias.modelled else unbounded)[name].add(alias.term)
    found = {}
    for name, sd, nominal in zip(bound.names, beta.std(axis=0), bound.prior_sd, strict=True):
        prior_sd = float(posterior["prior"][name].std()) if np.isfinite(nominal) else np.inf
        contraction = 1.0 - float(sd / prior_sd)
        shares = {term: fractions[name].get(term, 0.0) for term in sorted(alike[name])}
        partners = tuple(term for term, share in sorted(shares.items(), key=lambda pair: -pair[1]) if share > _NAMED)
        word: Word = "identified"
        if unbounded[name]:
            word, partners = "aliased", (*sorted(unbounded[name]), *partners)
        elif sum(shares.values()) > _ALIASED:
            word = "aliased"
        elif contraction < 1.0 - _CONTRACTED:
            word = "prior-limited"
        found[name] = Verdict(word, partners, contraction, fractions[name])
    return found


def _words(term: str) -> str:
    """BallForm → ball form."""
    return re.sub(r"(?<!^)(?=[A-Z])", " ", term).lower()


def _variances(precision: Array, free: Array, wanted: Array) -> Array:
    """Diagonal of the inverse of the precision of the free coefficients, at the wanted ones."""
    root = np.linalg.cholesky(precision[np.ix_(free, free)])
    position = {int(i): k for k, i in enumerate(free)}
    unit = np.zeros((len(free), len(wanted)))
    unit[[position[int(i)] for i in wanted], np.arange(len(wanted))] = 1.0
    white = np.linalg.solve(root, unit)
    return np.einsum("ij,ij->j", white, white)
