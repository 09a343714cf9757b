"""Names of effects and of units in words, and lists of names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from ldbb_bayes.model.terms import Term
from ldbb_bayes.model.terms.columns import PARAMETERS
from ldbb_bayes.report.wording.fixed_texts import SENTENCES
from ldbb_bayes.units import display_name, display_unit

__all__ = [
    "first_names",
    "joined",
    "joined_parameters",
    "joined_sizes",
    "nuisance_words",
    "source_in_table",
    "source_unit_words",
    "source_words",
    "term_words",
    "unit_words",
]

_MOST_NAMES = 5  # largest number of campaigns or tests that a sentence names


def joined(items: Sequence[str], word: str = "and") -> str:
    """Return items joined to one string, such as "a, b and c".

    ``word`` is the word before the last item.
    """
    if len(items) < 3:
        return f" {word} ".join(items)
    return f"{', '.join(items[:-1])} {word} {items[-1]}"


def first_names(names: Sequence[str]) -> str:
    """Return a string with at most five names of tests or campaigns, and the number of others."""
    text = ", ".join(names[:_MOST_NAMES])
    if len(names) > _MOST_NAMES:
        text += f" and {len(names) - _MOST_NAMES} more"
    return text


def joined_parameters(names: Sequence[str]) -> str:
    """Return a string with the names of parameters, such as "C_XXX and C_YYY"."""
    return joined([display_name(name) for name in names])


def unit_words(name: str) -> tuple[float, str]:
    """Return the size and the label of the unit in which a nuisance coefficient is shown.

    The size is in internal units (mm, N, rad). For example, the size is 1e-3 (mm) for the label
    "µm". A nuisance coefficient describes an effect that is modelled but not of interest.
    """
    inside_unit, unit_size, label = Term.owner(name).unit_of(name)
    if inside_unit.endswith("/N"):
        factor, label = display_unit(inside_unit)
        return 1.0 / factor, label
    return unit_size, label


def source_unit_words(source: str, term: str, unit: str) -> tuple[float, str]:
    """Return the unit in which an uncertainty budget shows the standard uncertainty of a source.

    The unit is returned as two values: the factor that converts the internal unit (mm, N, rad) to
    the unit shown, and the label of the unit shown. ``source`` is the name of a nuisance
    coefficient, which describes an effect that is modelled but not of interest. ``term`` is the
    class name of its model term. For noise, both names are the same. ``unit`` is the internal unit;
    it is used only for noise.
    """
    if source == term:
        if unit == "N":
            return 1.0, "N"
        return 1e3, "µm"
    unit_size, label = unit_words(source)
    return 1.0 / unit_size, label


def nuisance_words(name: str) -> str:
    """Return the name of a nuisance coefficient in words.

    For example, the name ``form_cos2`` in words is "2-lobe form (cos 2θ)". A nuisance coefficient
    describes an effect that is modelled but not of interest.
    """
    return Term.owner(name).describe(name)


def term_words(term: str) -> str:
    """Return the name of an effect in words, such as "ball form" for the model term ``BallForm``.

    ``term`` is the class name of a model term. It may also be the name of a parameter, which is
    then returned as tables show it, such as C_XXX.
    """
    if term in Term.kinds:
        return Term.kinds[term].words
    if term in SENTENCES["sources"]:
        return str(SENTENCES["sources"][term])
    if "_" in term:
        return display_name(term)
    return re.sub(r"(?<!^)(?=[A-Z])", " ", term).lower()


def source_words(term: str) -> str:
    """Return the name, in words, of a source of uncertainty in an uncertainty budget.

    ``term`` is the class name of a model term, or "Parameters" for the parameters' own priors.
    """
    if term == PARAMETERS:
        return "prior of the parameters"
    return term_words(term)


def source_in_table(name: str) -> str:
    """Return the name of a source of variance in words, as a table shows it.

    The parameter's own prior is shown as "its prior".
    """
    if name == PARAMETERS:
        return "its prior"
    if "_" in name:
        return f"prior of {display_name(name)}"
    return term_words(name)


def joined_sizes(hyper_um: Mapping[str, float], equals: str) -> str:
    """Return a string with the values of hyper-parameters, such as "sigma = 0.2 µm, decay = 0.5".

    ``hyper_um`` is a mapping from the names of the hyper-parameters to their values. All values are
    in µm, except the hyper-parameter ``decay``, which is a pure number. Hyper-parameters whose
    names begin with ``lambda_`` are left out. Each of them is a factor for one circle: its random
    shift and unexplained deviations are larger by this factor than those of other circles.
    ``equals`` is the string between a name and its value.
    """
    sizes = []
    for name, value in hyper_um.items():
        if not name.startswith("lambda_"):
            unit = "" if name == "decay" else " µm"
            sizes.append(f"{name}{equals}{value:.2g}{unit}")
    return ", ".join(sizes)
