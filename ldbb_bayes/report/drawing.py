"""A figure as SVG to stand in a page."""

from __future__ import annotations

import html
import io
import re

import matplotlib as mpl
from matplotlib.figure import Figure

__all__ = ["inline_svg"]

_REFERENCE = re.compile(r'(\bid="|xlink:href="#|url\(#)')
_PROLOGUE = re.compile(r"^.*?(?=<svg)", re.DOTALL)
_METADATA = re.compile(r"<metadata>.*?</metadata>\s*", re.DOTALL)
_GEOMETRY = re.compile(r' (?:d|x|y|points)="[^"]*"')
_DIGITS = re.compile(r"(\.\d\d)\d+")


def inline_svg(figure: Figure, key: str, name: str) -> str:
    """A figure as SVG to stand in a page: responsive, with an accessible name, its ids kept apart from other figures'."""
    drawn = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "ldbb", "svg.fonttype": "none"}):
        figure.savefig(drawn, format="svg", metadata={"Date": None}, transparent=True)
    text = _METADATA.sub("", _PROLOGUE.sub("", drawn.getvalue(), count=1))
    text = _REFERENCE.sub(rf"\g<1>{key}-", text)
    # A hundredth of a point is finer than any screen or printer.
    text = _GEOMETRY.sub(lambda match: _DIGITS.sub(r"\1", match[0]), text)
    title = f'<title id="title-{key}">{html.escape(name)}</title>'
    return re.sub(
        r"<svg ([^>]*)>", rf'<svg role="img" aria-labelledby="title-{key}" \g<1>>' + title.replace("\\", r"\\"), text, count=1
    )
