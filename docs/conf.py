"""The documentation: Sphinx, MyST and numpydoc, without a network. What the package knows is
written from it, not by hand."""

from __future__ import annotations

import inspect
import json
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import resolve_name, walk_packages
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

import ldbb_bayes
from ldbb_bayes.fleet import dataset
from ldbb_bayes.reading import words
from ldbb_bayes.results import Result
from ldbb_bayes.units import DISPLAY_UNITS, UNITS_TO_WRITE

project = "ldbb_bayes"
author = copyright = "The ldbb_bayes developers"
version = release = ldbb_bayes.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "numpydoc",
    "sphinx_copybutton",
]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]
autosummary_generate = False
numpydoc_show_class_members = False
default_role = "py:obj"
smartquotes = False
# Types of other libraries, and of ours those that signatures alone name, have no place here.
nitpick_ignore_regex = [("py:class", ".*"), ("py:obj", r"typing\..*")]
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "Array": "ndarray"}
maximum_signature_line_length = 88

myst_enable_extensions = ["dollarmath", "deflist", "colon_fence", "attrs_inline"]
myst_heading_anchors = 4
html_theme = "furo"
html_title = f"ldbb_bayes {release}"
html_math_renderer = "mathml"
html_static_path, html_css_files = ["_static"], ["site.css"]
html_copy_source = html_show_sourcelink = False
pygments_style, pygments_dark_style = "friendly", "github-dark"

PACKAGE = Path(ldbb_bayes.__file__).parent


def commands() -> str:
    """Every command as Typer documents it; the panels of options that several commands have are
    written once, at the end."""
    from typer import Context
    from typer.cli import get_docs_for_click
    from typer.main import get_command

    from ldbb_bayes.cli import app

    whole: Any = get_command(app)
    panels: dict[str, dict[str, None]] = {}
    pages = []
    for name, command in whole.commands.items():
        text = get_docs_for_click(obj=command, ctx=Context(command), name=f"ldbb-bayes {name}")
        text = text.replace("; 0<=x<=9223372036854775807]", "]").replace(
            "```console\n$ ", "```text\n"
        )
        text = re.sub(r"^\* `--help`.*\n", "", text, flags=re.M)
        shared: dict[str, None] = {}
        for option in command.params:
            panel = getattr(option, "rich_help_panel", None)
            line = re.search(rf"^\* `{option.opts[0]}[ `].*\n", text, re.M)
            if (
                panel
                and line
                and sum(panel in _panels(other) for other in whole.commands.values()) > 1
            ):
                panels.setdefault(panel, {})[line[0]] = None
                shared[panel] = None
                text = text.replace(line[0], "")
        also = "; ".join(f"[{panel}](#{slug(panel)})" for panel in shared)
        pages.append(
            re.sub(r"^# `ldbb-bayes (.*)`", r"### \1", text)
            + (f"\nAnd of several commands: {also}.\n" if also else "")
        )
    common = (f"### {panel}\n\n{''.join(lines)}" for panel, lines in panels.items())
    return "\n".join(["## Each command", *pages, "## Options of several commands", "", *common])


def _panels(command: Any) -> set[str]:
    return {getattr(option, "rich_help_panel", "") for option in command.params}


def slug(heading: str) -> str:
    """The anchor of a heading, as GitHub and MyST make it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def shape(kind: str) -> str:
    """The keys of a result's JSON, and of the results in it, from the types that are written."""
    from pydantic import TypeAdapter
    from pydantic.json_schema import GenerateJsonSchema

    class Shapes(GenerateJsonSchema):
        def handle_invalid_for_json_schema(self, schema: Any, error_info: str) -> dict[str, Any]:
            return {"type": "array"}

    module, _, name = kind.rpartition(".")
    schema = TypeAdapter(getattr(import_module(module), name)).json_schema(
        mode="serialization", schema_generator=Shapes
    )
    parts = {name: schema} | schema.pop("$defs", {})
    if "$ref" in schema:
        parts[name] = parts.pop(schema["$ref"].rpartition("/")[2])
    text = ""
    for part, own in parts.items():
        if "properties" not in own:
            continue
        head = "" if part == name else f"**{part.lstrip('_')}**. "
        kind = kinds().get(part, object)
        names = {
            alias[1]: name
            for name, own_type in kind.__annotations__.items()
            if (alias := ALIAS.search(str(own_type)))
        }
        description = " ".join(own.get("description", "").split())
        text += f"{head}{description}\n\n| key | holds | what |\n|---|---|---|\n"
        for key, value in own["properties"].items():
            what = said(kind, names.get(key, key)).replace("|", "\\|")
            text += f"| `{key}` | {holds(value, parts)} | {what} |\n"
        text += "\n"
    return text


def holds(value: dict[str, Any], parts: dict[str, Any]) -> str:
    """What stands at a key, in words."""
    if "$ref" in value:
        part = value["$ref"].rpartition("/")[2]
        return holds(parts[part], parts) if "enum" in parts[part] else part.lstrip("_")
    if "enum" in value or "const" in value:
        return " or ".join(
            f"`{json.dumps(choice)}`" for choice in value.get("enum", [value.get("const")])
        )
    if "anyOf" in value:
        return " or ".join(holds(choice, parts) for choice in value["anyOf"])
    if isinstance(value.get("additionalProperties"), dict):
        return f"by name: {holds(value['additionalProperties'], parts)}"
    if "prefixItems" in value:
        return f"list of {', '.join(holds(item, parts) for item in value['prefixItems'])}"
    if value.get("type") == "array":
        return f"list of: {holds(value['items'], parts)}" if value.get("items") else "list"
    return {
        "string": "text",
        "integer": "whole number",
        "boolean": "true or false",
        "object": "object",
    }.get(value.get("type", "object"), value.get("type", "object"))


def table(heads: str, rows: Mapping[str, Any]) -> str:
    """Two columns."""
    return f"| {heads} |\n|---|---|\n" + "".join(
        f"| {key} | {value} |\n" for key, value in rows.items()
    )


def roles() -> str:
    """Words for what a column holds."""
    return table(
        "Column | Words", {role: ", ".join(synonyms) for role, synonyms in words.ROLES.items()}
    )


def units() -> str:
    """Units of what a column holds, in the names that the layout of tables uses."""
    return table(
        "Of | Units",
        {role: ", ".join(f"`{unit}`" for unit in known) for role, known in words.UNITS.items()},
    )


def reading() -> str:
    """Inside units beside those for reading."""
    rows = {
        f"`{unit}`": f"{label} = {1.0 / factor:g} {unit}"
        for unit, (factor, label) in DISPLAY_UNITS.items()
        if label
    }
    return table("Inside | For reading", rows)


def typed() -> str:
    """Units that a quantity may be typed in."""
    return ", ".join(f"`{unit}`" for unit in UNITS_TO_WRITE)


def batch() -> str:
    """Columns of a batch's table and their kinds."""
    kinds = {
        "string": "text",
        "int64": "whole number",
        "double": "number",
        "bool": "true or false",
        "list<string>": "texts",
    }
    known = {**dataset.COLUMN_TYPES, **dataset.STATISTICS_TYPES}
    return table(
        "Column | Holds", {f"`{name}`": kinds.get(kind, "numbers") for name, kind in known.items()}
    )


def api(names: str) -> str:
    """What public names are, and their docstrings."""
    rows, lines = {}, ["```{eval-rst}", ".. currentmodule:: ldbb_bayes"]
    for name in names.split():
        what: Any = resolve_name(f"ldbb_bayes.{name}")
        kind = (
            "module" if inspect.ismodule(what) else "class" if inspect.isclass(what) else "function"
        )
        first = (
            re.split(r"(?<=[.;])\s|\n\n", f"{inspect.getdoc(what)} ")[0]
            .rstrip(":;")
            .replace("\n", " ")
            .replace("|", "\\|")
        )
        same = kind == "class" and what.__name__ != name.rpartition(".")[2]
        hidden = ["model_config", *getattr(what, "__dataclass_fields__", ())]
        role = "mod" if kind == "module" else "obj"
        rows[f"{{py:{role}}}`{name} <ldbb_bayes.{name}>`"] = (
            f"Another name of `{what.__name__}`." if same else first
        )
        lines += [
            "",
            f".. auto{kind}:: ldbb_bayes.{name}",
            *(
                ["   :members:", f"   :exclude-members: {', '.join(hidden)}"]
                if kind != "function" and not same
                else []
            ),
        ]
    return "\n".join([table("Name | What", rows), *lines, "```"])


@cache
def shown() -> dict[str, str]:
    """Dotted names of what pages show, by their last part."""
    pages = "".join(
        page.read_text(encoding="utf-8")
        for page in (Path(__file__).parent / "reference" / "api").glob("*.md")
    )
    names = " ".join(re.findall(r"<!-- api: (.*?) -->", pages)).split()
    return {name.rpartition(".")[2]: f"ldbb_bayes.{name}" for name in names}


def linked(name: re.Match[str]) -> str:
    """What the reference shows, wherever it is spoken of."""
    return f":py:obj:`~{shown()[name[1]]}`" if name[1] in shown() else name[0]


@cache
def comments() -> dict[tuple[str, str], str]:
    """What ``#:`` in the source says of fields, by class and field."""
    modules = [
        module.name
        for module in walk_packages([str(PACKAGE)], "ldbb_bayes.")
        if "__main__" not in module.name
    ]
    found: dict[tuple[str, str], str] = {}
    for module in modules:
        documented = ModuleAnalyzer.for_module(module).find_attr_docs()
        found |= {key: " ".join(text).strip() for key, text in documented.items()}
    return found


def kinds() -> dict[str, type]:
    """Classes by name, of those modules of the package that are imported by now."""
    modules = [module for name, module in sys.modules.items() if name.startswith("ldbb_bayes.")]
    return {
        name: own
        for module in modules
        for name, own in vars(module).items()
        if inspect.isclass(own)
    }


def said(kind: type, name: str) -> str:
    """What the source says of a field, here or where it is inherited from."""
    return next(
        (
            comments()[own.__name__, name]
            for own in kind.__mro__
            if (own.__name__, name) in comments()
        ),
        "",
    )


def forms(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Put what our docstrings say in short (errors in a sentence, descriptions behind the colon) in
    the form of numpydoc."""
    text = "\n".join(lines)
    found = re.search(
        r"^(InputError) ((?:for|naming|when|where|names)\b.*?\.)(?: (?=[A-Z])|$)(?=\n|\Z)",
        text,
        re.M | re.S,
    )
    if found:
        text = text.replace(found[0], "")
    text = re.sub(
        r"^(\w[\w, *]*) : (.*[.:,;\w)])(?=\n    [a-z(`0-9]|\n(?!    )|\Z)",
        lambda own: (
            own[0] if re.fullmatch(r"\w+|\{.*|mapping .*", own[2]) else f"{own[1]}\n    {own[2]}"
        ),
        text,
        flags=re.M,
    )
    head, returns, body = text.partition("Returns\n-------\n")
    if returns and not re.match(r"\w+ : |\w+\n    ", body):
        kind = (
            str(inspect.get_annotations(obj).get("return", "result"))
            .replace("pd.", "")
            .replace("xr.", "")
        )
        body, blank, rest = body.partition("\n\n")
        text = (
            f"{head}{returns}{kind}\n"
            + "".join(f"    {line}\n" for line in body.splitlines())
            + blank
            + rest
        )
    if found:
        error = "\n".join(f"    {line}" for line in found[2].splitlines())
        text = f"{text.rstrip()}\n\nRaises\n------\nInputError\n{error}\n"
    if what == "class" and is_dataclass(obj):
        rows = (
            f"{own.name} : {unchecked(str(own.type))}\n    {said(obj, own.name)}\n"
            for own in fields(obj)
            if own.repr
        )
        text = f"{text.rstrip()}\n\nAttributes\n----------\n{''.join(rows)}"
    text = re.sub(r"(?<![`:])`(?:ldbb_bayes\.)?(\w+)`(?!`)", linked, text)
    lines[:] = re.sub(r"(?<!`)\|(\w[^|\n]*)\|", r"\|\1\|", text).split("\n")


def unchecked(signature: str) -> str:
    """Types without what checks the values."""
    signature = re.sub(
        r"TypeAliasForwardRef\('(\w+)'\)", r"\1", signature.replace("<factory>", "...")
    )
    while (start := signature.find("Annotated[")) >= 0:
        depth, end, comma = 0, start + len("Annotated["), 0
        while depth >= 0:
            comma = comma or (end if signature[end] == "," and depth == 0 else 0)
            depth += {"[": 1, "(": 1, "]": -1, ")": -1}.get(signature[end], 0)
            end += 1
        signature = (
            signature[:start]
            + signature[start + len("Annotated[") : comma or end - 1]
            + signature[end:]
        )
    return signature


def plain_types(
    app: Sphinx,
    what: str,
    name: str,
    obj: Any,
    options: Any,
    signature: str | None,
    returned: str | None,
) -> Any:
    """Signatures in short; none of results, which nobody makes."""
    made = inspect.isclass(obj) and issubclass(obj, Result) and obj is not ldbb_bayes.HybridModel
    return "" if made else unchecked(signature or "") or None, returned


ALIAS = re.compile(r"alias='(\w+)'")
WRITTEN: dict[str, Callable[[str], str]] = {
    "commands": lambda _: commands(),
    "roles": lambda _: roles(),
    "units": lambda _: units(),
    "batch": lambda _: batch(),
    "reading": lambda _: reading(),
    "typed": lambda _: typed(),
    "shape": shape,
    "api": api,
}


def write(app: Sphinx, page: str, source: list[str]) -> None:
    """Put what is written from the package where a page has ``<!-- its name: of what -->``."""
    source[0] = re.sub(
        r"(?<!!)\[([^]]+)\]\((\.\./[^)#]*)[^)]*\)",
        lambda link: named(link, app.srcdir / page),
        source[0],
    )
    markers = rf"<!-- ({'|'.join(WRITTEN)}):?([^>]*) -->"
    source[0] = re.sub(markers, lambda marker: WRITTEN[marker[1]](marker[2].strip()), source[0])


def named(link: re.Match[str], page: Path) -> str:
    """Return a link as it is, or the words of one that leads out of the documentation with the
    place of the file."""
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
    app.connect("autodoc-process-docstring", forms, priority=400)
    app.connect("autodoc-process-signature", plain_types)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
