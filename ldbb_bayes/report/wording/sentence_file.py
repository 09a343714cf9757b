"""Files with templates of sentences, and the sentences that they make from results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, TypeVar

import jinja2

from ldbb_bayes.report.wording.effect_names import joined, nuisance_words, term_words
from ldbb_bayes.report.wording.number_words import p_value_words, probability_words
from ldbb_bayes.units import counted, display_name, round_like, typeset, with_sign

__all__ = ["SentenceFile"]

Filter = TypeVar("Filter", bound=Callable[..., Any])


class SentenceFile:
    """A file with templates of sentences on one kind of result.

    The file is in the folder templates/sentences. Each macro of it makes sentences from results; a
    line that is not empty is one sentence, or two sentences that belong together. The file is
    compiled when its first sentence is needed, so that a command compiles only the files that it
    uses.

    Parameters
    ----------
    name
        Name of the file without its ending, such as "fit".
    values
        Values that the templates use. The keys are their names in the templates.
    """

    def __init__(self, name: str, **values: Any) -> None:
        """Store the name of the file and the values that its templates use."""
        self._name = name
        self._values = values
        self._filters: dict[str, Callable[..., Any]] = {
            "as_": format,
            "lines": _nonempty_lines,
            "point": _point_words,
        }
        for function in (
            joined,
            counted,
            display_name,
            round_like,
            typeset,
            with_sign,
            term_words,
            nuisance_words,
            p_value_words,
            probability_words,
            repr,
        ):
            self.filter(function)

    def filter(self, function: Filter) -> Filter:
        """Decorate a function that the templates of this file use as a filter, by its name."""
        self._filters[function.__name__] = function
        return function

    def sentences(self, macro: str, *findings: Any) -> tuple[str, ...]:
        """Return the sentences that a macro of the file makes from results.

        ``macro`` is the name of the macro. ``findings`` are the results that the macro takes as its
        arguments.
        """
        return tuple(_nonempty_lines(getattr(self._macros, macro)(*findings)))

    def sentence(self, macro: str, *findings: Any) -> str:
        """Return one line with all sentences that a macro of the file makes from results.

        ``macro`` is the name of the macro. ``findings`` are the results that the macro takes as its
        arguments.
        """
        return " ".join(self.sentences(macro, *findings))

    def fill(self, template: str, values: Mapping[str, Any]) -> str:
        """Return the text that a template makes, which may use the filters of the file.

        ``template`` is the template itself. ``values`` are the values that it uses; the keys are
        their names in the template.
        """
        return self._environment.from_string(template).render(values)

    @cached_property
    def _environment(self) -> jinja2.Environment:
        """Jinja environment with the filters and values that the templates of the file use."""
        loader = jinja2.PackageLoader("ldbb_bayes.report", "templates/sentences")
        environment = jinja2.Environment(loader=loader, undefined=jinja2.StrictUndefined)
        environment.filters.update(self._filters)
        environment.globals.update(self._values)
        return environment

    @cached_property
    def _macros(self) -> Any:
        """Jinja module whose attributes are the macros of the file."""
        return self._environment.get_template(f"{self._name}.j2").module


def _nonempty_lines(text: str) -> list[str]:
    """Return the lines of a text without the spaces around them. Empty lines are left out."""
    lines = [line.strip() for line in text.split("\n")]
    return [line for line in lines if line]


def _point_words(point: tuple[float, ...]) -> str:
    """Return the coordinates of a point as a string, such as "(0, 0, 150)"."""
    return f"({', '.join(f'{coordinate:g}' for coordinate in point)})"
