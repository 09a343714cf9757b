"""The verdict on one parameter, and the rule behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from numpy.typing import NDArray

from ldbb_bayes.analysis.confounding import Confounding
from ldbb_bayes.model.degeneracies import Degeneracy
from ldbb_bayes.model.wording import term_words

__all__ = ["TENTH", "Verdict", "verdict_of"]

Array = NDArray[Any]
Word = Literal["identified", "prior-limited", "aliased"]
TENTH = 0.1
_HALF = 0.5
_CONTRACTED = 0.75
_NAMED = 0.05


@dataclass(frozen=True)
class Verdict:
    """What is known of one parameter, in a word.

    The rule, in this order:

    1. *aliased*, when a nuisance that the model leaves out looks exactly like it: nothing bounds it then.
    2. *aliased*, when more than half of its variance lies along directions in which the priors outweigh the readings, and more
       than half would vanish if something else were known: the nuisance terms, and with them the parameters that no reading
       tells it from; or, where the priors outweigh the readings tenfold, the parameter it is correlated with most.
    3. *prior-limited*, when the contraction is below 0.75: the posterior sd is more than half of the prior sd.
    4. *identified* otherwise.

    Attributes
    ----------
    word : {"identified", "prior-limited", "aliased"}
    partners : tuple of str
        Terms (then parameters) that it cannot be told from, the heaviest first; of a parameter that is not aliased the terms
        that hold at least 5 % of its variance all the same.
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
        plain = ", ".join(f"{term_words(partner)} {self._share(partner)}" for partner in self.partners)
        return f"{self.word} ({plain})" if plain else self.word

    def _share(self, partner: str) -> str:
        return f"{100.0 * self.share[partner]:.0f} %" if partner in self.share else "left out"


def verdict_of(
    confounding: Confounding,
    i: int,
    rivals: Mapping[str, float],
    unseen: Array,
    contraction: float,
    mine: tuple[Degeneracy, ...],
) -> Verdict:
    """See `Verdict` for the rule.

    ``i``: its number among the parameters; ``rivals``: squared correlations with the other parameters; ``unseen``: shares of the
    variance where the priors outweigh the readings, once and tenfold, shape (2,); ``mine``: its degeneracies.
    """
    share = {term: float(values[i]) for term, values in confounding.fraction.items()} | dict(rivals)
    shared = confounding.information.shared_terms
    heavy = tuple(sorted((t for t in shared if share[t] > _NAMED), key=lambda t: -share[t]))
    alike = {d.term for d in mine if d.modelled}
    exact = tuple(term for term in heavy if term in alike)
    left_out = tuple(dict.fromkeys(d.term for d in mine if not d.modelled))
    if left_out:
        return Verdict("aliased", (*left_out, *exact), share)
    twins = sorted({n for d in mine if not d.term for n in d.parameters if n in rivals}, key=lambda n: -rivals[n])
    told = tuple(name for name in (*(exact or heavy), *twins) if share[name] > _NAMED)
    if unseen[0] > _HALF and told and confounding.lost_by_knowing((*shared, *twins))[i] > _HALF:
        return Verdict("aliased", told, share)
    rival = max(rivals, key=lambda n: rivals[n], default="")
    if unseen[1] > _HALF and rival and rivals[rival] > _HALF:
        return Verdict("aliased", (rival,), share)
    return Verdict("prior-limited" if contraction < _CONTRACTED else "identified", heavy, share)
