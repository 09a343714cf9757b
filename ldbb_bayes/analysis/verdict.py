"""The verdict on one parameter, and the rule behind it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from ldbb_bayes.analysis.confounding import Confounding
from ldbb_bayes.model.degeneracies import Degeneracy
from ldbb_bayes.units import display_name

__all__ = ["Verdict", "term_words", "verdict_of"]

Word = Literal["identified", "prior-limited", "aliased"]
_HALF = 0.5
_CONTRACTED = 0.75
_NAMED = 0.05


@dataclass(frozen=True)
class Verdict:
    """What is known of one parameter, in a word.

    The rule, in this order:

    1. *aliased*, when a nuisance that the model leaves out looks exactly like it: nothing bounds it then.
    2. *aliased*, when more than half of its variance lies along directions in which the priors outweigh the readings tenfold, and
       more than half would vanish if something else were known: the nuisance terms, and with them the parameters that no reading
       tells it from; or, where no nuisance counts, the parameter it is correlated with most.
    3. *prior-limited*, when the contraction is below 0.75: the posterior sd is more than half of the prior sd.
    4. *identified* otherwise.

    Attributes
    ----------
    word : {"identified", "prior-limited", "aliased"}
    partners : tuple of str
        Terms (then parameters) that it cannot be told from, the heaviest first. Partners of an identified parameter are terms
        that look exactly like it in part and hold at least 5 % of its variance.
    share : mapping of partner to float
        Of the variance; what the model leaves out has none.
    """

    word: Word
    partners: tuple[str, ...]
    share: Mapping[str, float]

    @property
    def text(self) -> str:
        """In words, with the share of the variance that every partner holds."""
        named = [f"{term_words(partner)} ({self._share(partner)})" for partner in self.partners]
        if self.word == "aliased":
            return "aliased with " + " and ".join(named)
        words = {"identified": "from the readings", "prior-limited": "mostly the prior"}[self.word]
        plain = ", ".join(f"{term_words(partner)} {self._share(partner)}" for partner in self.partners)
        return f"{words} ({plain})" if plain else words

    def _share(self, partner: str) -> str:
        return f"{100.0 * self.share[partner]:.0f} %" if partner in self.share else "left out"


def verdict_of(
    confounding: Confounding,
    i: int,
    rivals: Mapping[str, float],
    unseen: float,
    contraction: float,
    mine: tuple[Degeneracy, ...],
) -> Verdict:
    """See `Verdict` for the rule. ``rivals``: squared correlations with the other parameters; ``mine``: its degeneracies."""
    share = {term: float(values[i]) for term, values in confounding.fraction.items()} | dict(rivals)
    shared = confounding.information.shared_terms
    heavy = tuple(sorted((t for t in shared if share[t] > _NAMED), key=lambda t: -share[t]))
    alike = {d.term for d in mine if d.modelled}
    exact = tuple(term for term in heavy if term in alike)
    left_out = tuple(dict.fromkeys(d.term for d in mine if not d.modelled))
    if left_out:
        return Verdict("aliased", (*left_out, *exact), share)
    if unseen > _HALF:
        twins = sorted({n for d in mine if not d.term for n in d.parameters if n in rivals}, key=lambda n: -rivals[n])
        nearest = [n for n in (max(rivals, key=lambda n: rivals[n], default=""),) if n and not twins and not heavy]
        for partners, named in (((*shared, *twins), (*(exact or heavy), *twins)), (nearest, nearest)):
            told = tuple(name for name in named if share[name] > _NAMED)
            if told and confounding.lost_by_knowing(partners)[i] > _HALF:
                return Verdict("aliased", told, share)
    return Verdict("prior-limited" if contraction < _CONTRACTED else "identified", exact, share)


def term_words(term: str) -> str:
    """BallForm → ball form; a parameter's name stays."""
    return display_name(term) if "_" in term else re.sub(r"(?<!^)(?=[A-Z])", " ", term).lower()
