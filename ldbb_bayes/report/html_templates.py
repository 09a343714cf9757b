"""Jinja templates of the HTML page and of the digital calibration certificate (DCC)."""

from __future__ import annotations

import jinja2

from ldbb_bayes.units import keep_with_units, typeset

__all__ = ["template_of"]


def _kind(content: object) -> str:
    """Return the class name of a part of the page, such as Table, for the page's template."""
    return type(content).__name__


def _full_precision(value: float) -> str:
    """Return a number as a string with all digits that are needed to read it back exactly."""
    return repr(float(value))


def _typeset_passage(text: str) -> str:
    """Return a passage with true minus signs, and with numbers that stay with their units."""
    return keep_with_units(typeset(text))


def template_of(name: str) -> jinja2.Template:
    """Return a Jinja template that escapes all text inserted into it.

    Parameters
    ----------
    name
        Name of the template's file in the folder ``templates``, such as ``report.html.j2``.

    Returns
    -------
    Template
        The template. Its method ``render`` raises an error if a variable is missing.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("ldbb_bayes.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["typeset"] = _typeset_passage
    environment.filters["kind"] = _kind
    environment.filters["number"] = _full_precision
    return environment.get_template(name)
