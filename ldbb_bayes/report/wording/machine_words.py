"""Sentences on a machine and on what circular tests can determine of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ldbb_bayes.report.wording.sentence_file import SentenceFile
from ldbb_bayes.units import display_name

if TYPE_CHECKING:
    from ldbb_bayes.analysis.machine_description import VisibleParameter

__all__ = ["machine_sentences", "sum_in_words"]

_TEMPLATES = SentenceFile("machine")


def machine_sentences(machine: Any) -> tuple[str, ...]:
    """Return sentences on a machine's joints and on what circular tests can determine.

    The sentences also state how many compliances the readings can separate, and which parameters
    have no effect on the readings.
    """
    return _TEMPLATES.sentences("machine_sentences", machine)


def sum_in_words(parameter: VisibleParameter) -> str:
    """Return the sum of parameters that ``parameter`` stands for, such as "C_XXX + C_XXY".

    Circular tests determine only this weighted sum. A weight is stated only if it differs from 1;
    its unit is mm or mm².
    """
    text = ""
    for name, weight in parameter.members.items():
        sign = ""
        if text:
            sign = " − " if weight < 0 else " + "
        elif weight < 0:
            sign = "−"
        if abs(weight) != 1.0:
            sign += f"{abs(weight):g} "
        text += sign + display_name(name)
    return text
