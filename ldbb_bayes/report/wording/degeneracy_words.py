"""Sentences on degeneracies: combinations that the readings cannot separate.

A degeneracy is a combination of parameters and other effects. A nuisance coefficient describes an
effect that is modelled but not of interest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ldbb_bayes.model.terms import Term
from ldbb_bayes.report.wording.effect_names import (
    joined,
    joined_parameters,
    nuisance_words,
    term_words,
    unit_words,
)
from ldbb_bayes.report.wording.fixed_texts import SENTENCES
from ldbb_bayes.units import display_name, display_unit, round_uncertainty

if TYPE_CHECKING:
    from ldbb_bayes.analysis.aliases import Degeneracy
    from ldbb_bayes.analysis.cures import Cure

__all__ = ["cure_items", "cure_words", "degeneracy_items", "degeneracy_sentence"]


def degeneracy_sentence(degeneracy: Degeneracy) -> str:
    """Return a sentence that describes a degeneracy.

    A degeneracy is a combination of parameters and other effects that the readings cannot separate.
    A change of one parameter or effect can be compensated by changes of the others. For a
    degeneracy of parameters, the sentence states amounts of the parameters that together change no
    reading. For a degeneracy of an effect with parameters, the sentence states amounts of the
    parameters that change the readings exactly as a stated amount of the effect does.
    """
    sign = -1.0 if degeneracy.term else 1.0
    changes = []
    for name in degeneracy.parameters:
        factor, label = display_unit(degeneracy.units[name])
        change = sign * degeneracy.combination[name]
        changes.append(_amount_words(change, factor, label, display_name(name)))
    ending = "."
    if not degeneracy.modelled:
        ending = "; the model leaves it out, and the intervals do not cover it."

    number = len(degeneracy.nuisances)
    if not degeneracy.term:
        if number:
            changes.append(f"{number} other effects")
        return f"{joined(changes)} together change no reading{ending}"
    return f"{_effect_words(degeneracy)} looks exactly like {joined(changes)}{ending}"


def _effect_words(degeneracy: Degeneracy) -> str:
    """Return a string that lists the sizes of the nuisance effects in a degeneracy.

    Nuisance effects are modelled but not of interest. A degeneracy is a combination of parameters
    and nuisance effects that the readings cannot separate, because the effects together change the
    readings in the same way as the parameters.
    """
    amounts = []
    for name in degeneracy.nuisances:
        unit_size, unit = unit_words(name)
        amount = degeneracy.combination[name]
        amounts.append(_amount_words(amount, 1.0 / unit_size, unit, nuisance_words(name), ""))
    if len(amounts) > 4:
        return f"{amounts[0]} together with {len(amounts) - 1} other effects"
    if len(amounts) > 1:
        return f"{amounts[0]} with {joined(amounts[1:])}"
    return "".join(amounts)


def _amount_words(value: float, factor: float, label: str, name: str, plus: str = "+") -> str:
    """Return a value of a parameter or effect with unit and name, such as "+6.67 µm/m of E_XX1".

    ``value`` is multiplied by ``factor`` to convert it to the unit ``label``. ``name`` is the name
    of the parameter or effect. ``plus`` is the string before a positive value.
    """
    size = abs(value) * factor
    if size < 0.01 and label.startswith("µ"):
        size *= 1e3
        label = "n" + label[1:]
    sign = plus if value > 0 else "−"
    space = "" if label == "°" else " "
    return f"{sign}{round_uncertainty(size, 3)[0]}{space}{label} of {name}"


def cure_words(degeneracy: Degeneracy, cures: Sequence[Cure]) -> str:
    """Return a sentence on what would resolve a degeneracy.

    A degeneracy is a combination of parameters and other effects that the readings cannot separate.
    ``cures`` are ways to resolve it, such as tests at other forces or a calibration. If ``cures``
    is empty, the sentence recommends a narrower prior.
    """
    calibration = "a calibration of it"
    if degeneracy.term in Term.kinds:
        calibration = Term.kinds[degeneracy.term].calibration
    text = joined([SENTENCES["cures"].get(cure, calibration) for cure in cures], "or")
    if not text:
        text = "a narrower prior on one of them"
    return text[0].upper() + text[1:] + "."


def degeneracy_items(
    degeneracies: Sequence[Degeneracy], cures: Sequence[Sequence[Cure]]
) -> tuple[str, ...]:
    """Return a description of each degeneracy, and of what would resolve it.

    A degeneracy is a combination of parameters and other effects that the readings cannot separate.
    ``cures`` has one entry for each of ``degeneracies``, in the same order: the tests or
    calibrations that would resolve the degeneracy.
    """
    items = []
    for degeneracy, cures_of_it in zip(degeneracies, cures, strict=True):
        items.append(
            f"{degeneracy_sentence(degeneracy)} Cure: {cure_words(degeneracy, cures_of_it)}"
        )
    return tuple(items)


def cure_items(
    degeneracies: Sequence[Degeneracy], cures: Sequence[Sequence[Cure]]
) -> tuple[str, ...]:
    """Return descriptions of confounded effects, and of the tests that would separate them.

    Effects that the same tests or calibrations would separate are named together.

    Parameters
    ----------
    degeneracies
        Combinations of parameters and effects that no reading of a set of tests can separate.
    cures
        Tests or calibrations that would resolve each degeneracy, in the order of ``degeneracies``.

    Returns
    -------
    tuple of str
    """
    first_of_effect: dict[str, Degeneracy] = {}
    cures_of_effect: dict[str, list[Cure]] = {}
    for degeneracy, cures_of_it in zip(degeneracies, cures, strict=True):
        effect = joined_parameters(degeneracy.parameters)
        if degeneracy.term:
            effect = term_words(degeneracy.term)
        first_of_effect.setdefault(effect, degeneracy)
        common = cures_of_effect.get(effect, cures_of_it)
        cures_of_effect[effect] = [cure for cure in common if cure in cures_of_it]
    effects_by_cure: dict[str, list[str]] = {}
    for effect, common in cures_of_effect.items():
        cure = cure_words(first_of_effect[effect], common)
        effects_by_cure.setdefault(cure, []).append(effect)
    items = []
    for cure, effects in effects_by_cure.items():
        items.append(f"{joined(effects)}: {cure[0].lower()}{cure[1:]}")
    return tuple(items)
