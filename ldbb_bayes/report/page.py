"""A document as one self-contained HTML page, and as Markdown."""

from __future__ import annotations

import html
import re
from typing import Any

import jinja2
from markupsafe import Markup

from ldbb_bayes.report.document import Bullets, Details, Document, Paragraph, Part, Picture, Sheet

__all__ = ["html_page", "markdown_page", "typeset"]

_LOADER = jinja2.PackageLoader("ldbb_bayes.report")
_MINUS = re.compile(r"(?<![\w.\-])-(?=\d)")
_EXPONENT = re.compile(r"(?<=\d)e([+-])0*(\d+)\b")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_SPECIAL = re.compile(r"([\\`*\[\]|])")


def html_page(document: Document) -> str:
    """No script, no request: figures as inline SVG, every text escaped, a policy that forbids the browser to load anything."""
    environment = jinja2.Environment(loader=_LOADER, autoescape=True, undefined=jinja2.StrictUndefined)
    environment.filters["typeset"] = typeset
    parts = environment.get_template("parts.html.j2")

    def show(part: Part) -> Markup:
        drawing = Markup(part.svg) if isinstance(part, Picture) else Markup("")
        return Markup(parts.render(kind=type(part).__name__, part=part, drawing=drawing, show=show))

    style = Markup(_LOADER.get_source(environment, "report.css")[0])
    return environment.get_template("report.html.j2").render(document=document, style=style, show=show)


def markdown_page(document: Document) -> str:
    """The text and the tables of the page; figures by their captions."""
    environment = jinja2.Environment(loader=_LOADER, autoescape=False, undefined=jinja2.StrictUndefined, trim_blocks=True)
    environment.filters["md"] = lambda text: _escaped(typeset(text))
    text = environment.get_template("report.md.j2").render(document=document, show=_markdown)
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"


def _markdown(part: Part) -> str:
    return _WRITERS[type(part)](part)


def _paragraph(part: Paragraph) -> str:
    return f"```toml\n{part.text.strip()}\n```\n\n" if "\n" in part.text else f"{_escaped(typeset(part.text))}\n\n"


def _bullets(part: Bullets) -> str:
    return "".join(f"- {_escaped(typeset(item))}\n" for item in part.items) + "\n"


def _sheet(part: Sheet) -> str:
    rows = [part.heads, *part.rows]
    lines = ["| " + " | ".join(_escaped(typeset(cell)) for cell in row) + " |" for row in rows]
    rule = "|" + "|".join("---:" if numeric else "---" for numeric in part.numeric) + "|"
    return "\n".join([f"{_escaped(typeset(part.caption))}\n", lines[0], rule, *lines[1:]]) + "\n\n"


def _picture(part: Picture) -> str:
    return f"Figure: {_escaped(typeset(part.caption))}\n\n"


def _details(part: Details) -> str:
    return f"### {_escaped(typeset(part.summary))}\n\n" + "".join(_markdown(inner) for inner in part.parts)


_WRITERS: dict[Any, Any] = {
    Paragraph: _paragraph,
    Bullets: _bullets,
    Sheet: _sheet,
    Picture: _picture,
    Details: _details,
}


def typeset(text: str) -> str:
    """Minus signs before numbers, powers of ten in full: -5.85 → −5.85, 3.1e-05 → 3.1·10⁻⁵."""
    text = _EXPONENT.sub(lambda match: f"·10{(match[1].replace('+', '') + match[2]).translate(_RAISED)}", text)
    return _MINUS.sub("−", text)


def _escaped(text: str) -> str:
    """What Markdown and HTML would read as marks, as plain text on one line."""
    plain = " ".join(text.split())
    return _SPECIAL.sub(r"\\\1", html.escape(plain, quote=False))
