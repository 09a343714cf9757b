"""The documentation: Sphinx, MyST and numpydoc, without a network. What the package knows is written from it, not by hand."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx

import ldbb_bayes

project = "ldbb_bayes"
author = copyright = "The ldbb_bayes developers"
version = release = ldbb_bayes.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.viewcode", "numpydoc", "sphinx_copybutton"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]
autosummary_generate = False
numpydoc_show_class_members = False

myst_enable_extensions = ["dollarmath", "deflist", "colon_fence", "attrs_inline"]
myst_heading_anchors = 4
html_theme = "furo"
html_title = f"ldbb_bayes {release}"
html_math_renderer = "mathml"
html_copy_source = html_show_sourcelink = False
pygments_style, pygments_dark_style = "friendly", "github-dark"

PACKAGE = Path(ldbb_bayes.__file__).parent


def glossary() -> str:
    """The terms of art, as the page of a report explains them."""
    terms = tomllib.loads((PACKAGE / "report" / "templates" / "glossary.toml").read_text(encoding="utf-8"))
    return "\n".join(f"{term}\n: {text}\n" for term, text in terms.items())


WRITTEN = {"glossary": glossary}


def write(app: Sphinx, page: str, source: list[str]) -> None:
    """Put what is written from the package where a page has ``<!-- its name -->``."""
    for folder in {"tutorials", "how-to", "explanation", "reference/api"}:
        if page == "index" and not any((Path(__file__).parent / folder).glob("*.md")):
            source[0] = source[0].replace(f"\n{folder}/*\n", "\n")
    source[0] = re.sub(r"\[([^]]+)\]\((\.\./[^)#]*)[^)]*\)", lambda link: named(link, app.srcdir / page), source[0])
    for name, text in WRITTEN.items():
        marker = f"<!-- {name} -->"
        if marker in source[0]:
            source[0] = source[0].replace(marker, text())


def named(link: re.Match[str], page: Path) -> str:
    """Return a link as it is, or the words of one that leads out of the documentation with the place of the file."""
    target = (page.parent / link[2]).resolve()
    place = target.relative_to(PACKAGE.parent).as_posix().removesuffix("/README.md")
    inside = target.is_relative_to(Path(__file__).parent)
    return link[0] if inside else link[1] if place in link[1] else f"{link[1]} (`{place}`)"


def mathml(translator: Any, node: nodes.math | nodes.math_block) -> None:
    """Formulas that browsers draw themselves, without scripts or fonts from elsewhere."""
    block = isinstance(node, nodes.math_block)
    formula = tex2mathml(node.astext(), as_block=block)
    translator.body.append(f'<div class="math">{formula}</div>' if block else formula)
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", (mathml, None), (mathml, None))
    app.connect("source-read", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
