"""How plain Python code is: names on a line, nesting, length and complexity of functions."""

from __future__ import annotations

import ast
import io
import keyword
import re
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

COLUMNS = 100
UNFORMATTED = re.compile(r"fmt: (skip|off)")
STATEMENTS = 40
COMPLEXITY = 12

# Words that say of a thing that it is there, not what it is.
VAGUE_WORDS = """
own found each few part parts what of made given every mine theirs left kept rest said told
shown seen others more most least alike apart together alone met moved drawn known used way
ways whole here there within why got cure must same several enough before after done this that
odd taken held meant among beside tmp res ret val vals obj stuff thing things
"""
VAGUE_NAMES = frozenset(VAGUE_WORDS.split())

Function = ast.FunctionDef | ast.AsyncFunctionDef
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
BRANCHES = (
    ast.If,
    ast.For,
    ast.While,
    ast.IfExp,
    ast.ExceptHandler,
    ast.BoolOp,
    ast.comprehension,
    ast.match_case,
)
LAYOUT_TOKENS = frozenset(
    {
        tokenize.NL,
        tokenize.NEWLINE,
        tokenize.INDENT,
        tokenize.DEDENT,
        tokenize.ENDMARKER,
        tokenize.COMMENT,
    }
)


@dataclass(frozen=True)
class SourceFile:
    """One Python file, as text and as a syntax tree."""

    name: str
    text: str

    @cached_property
    def nodes(self) -> list[ast.AST]:
        return list(ast.walk(ast.parse(self.text)))

    @cached_property
    def names_by_line(self) -> Counter[int]:
        """Names that are no keywords, by the number of their line; 0 for other lines of code."""
        names: Counter[int] = Counter()
        # Fields of half a million tokens by their names would take a second.
        for kind, text, start, end, _ in tokenize.generate_tokens(io.StringIO(self.text).readline):
            if kind in LAYOUT_TOKENS:
                continue
            names[start[0]] += kind == tokenize.NAME and not keyword.iskeyword(text)
            if end[0] > start[0]:
                names.update(dict.fromkeys(range(start[0], end[0] + 1), 0))
        for line in self._docstring_lines():
            names.pop(line, None)
        return names

    def functions(self) -> Iterator[Function]:
        for node in self.nodes:
            if isinstance(node, FUNCTIONS):
                yield node

    def bound_names(self) -> Iterator[str]:
        """Names of variables and of arguments, once for every place that binds them."""
        for node in self.nodes:
            if isinstance(node, ast.arg):
                yield node.arg
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                yield node.id

    def _docstring_lines(self) -> Iterator[int]:
        documented = (ast.Module, ast.ClassDef, *FUNCTIONS)
        for node in self.nodes:
            if isinstance(node, documented) and ast.get_docstring(node) is not None:
                docstring = node.body[0]
                yield from range(docstring.lineno, (docstring.end_lineno or 0) + 1)


def read_sources(folder: Path) -> Iterator[SourceFile]:
    """Yield the files one after the other, as their trees together fill much memory."""
    for path in sorted(folder.rglob("*.py")):
        yield SourceFile(str(path), path.read_text(encoding="utf-8"))


@dataclass(frozen=True)
class FunctionSize:
    """Statements of a function and of what it nests, and its branches plus one."""

    statements: int
    complexity: int


def size_of(function: Function) -> FunctionSize:
    nodes = list(ast.walk(function))
    return FunctionSize(
        statements=sum(isinstance(node, ast.stmt) for node in nodes) - 1,
        complexity=sum(isinstance(node, BRANCHES) for node in nodes) + 1,
    )


def returns_bare_tuple(function: Function) -> bool:
    """Whether a function itself returns three or more values that have no names."""
    pending: list[ast.AST] = list(function.body)
    while pending:
        node = pending.pop()
        if isinstance(node, (*FUNCTIONS, ast.ClassDef, ast.Lambda)):
            continue
        value = node.value if isinstance(node, ast.Return) else None
        if isinstance(value, ast.Tuple) and len(value.elts) >= 3:
            return True
        pending.extend(ast.iter_child_nodes(node))
    return False


def is_nested_comprehension(node: ast.AST) -> bool:
    if not isinstance(node, COMPREHENSIONS):
        return False
    if len(node.generators) > 1:
        return True
    return any(isinstance(child, COMPREHENSIONS) for child in ast.walk(node) if child is not node)


def is_tuple_assignment(node: ast.AST) -> bool:
    """Whether a statement reads ``a, b = x, y``."""
    if not isinstance(node, ast.Assign):
        return False
    return isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple)


def is_small_function(node: ast.AST) -> bool:
    """Whether a node is a lambda or a call of functools.partial."""
    if isinstance(node, ast.Call):
        names = (getattr(node.func, "id", ""), getattr(node.func, "attr", ""))
        return "partial" in names
    return isinstance(node, ast.Lambda)


def is_vague(name: str) -> bool:
    return name.strip("_") in VAGUE_NAMES


def measure(sources: Iterable[SourceFile]) -> dict[str, float]:
    """Return the figures of `test_plainness.py`; "per 1000" counts lines of code."""
    counts: Counter[str] = Counter()
    for source in sources:
        lines = source.text.splitlines()
        names = source.names_by_line
        counts["code"] += len(names)
        counts["names"] += names.total()
        counts["long"] += sum(len(lines[number - 1]) > COLUMNS for number in names)
        counts["unformatted"] += len(UNFORMATTED.findall(source.text))
        counts["vague"] += sum(is_vague(name) for name in source.bound_names())
        for node in source.nodes:
            counts["nested"] += is_nested_comprehension(node)
            counts["tuples"] += is_tuple_assignment(node)
            counts["small functions"] += is_small_function(node)
            counts["conditional"] += isinstance(node, ast.IfExp)
            counts["walrus"] += isinstance(node, ast.NamedExpr)
        for function in source.functions():
            size = size_of(function)
            counts["functions"] += 1
            counts["long functions"] += size.statements > STATEMENTS
            counts["complex functions"] += size.complexity > COMPLEXITY
            counts["tuple functions"] += returns_bare_tuple(function)

    thousand = counts["code"] / 1000
    percent_of_functions = 100 / counts["functions"]
    return {
        "lines over 100 columns": counts["long"],
        "unformatted places": counts["unformatted"],
        "names per line": counts["names"] / counts["code"],
        "nested comprehensions per 1000": counts["nested"] / thousand,
        "a, b = x, y per 1000": counts["tuples"] / thousand,
        "conditional expressions per 1000": counts["conditional"] / thousand,
        "walrus per 1000": counts["walrus"] / thousand,
        "lambda and partial per 1000": counts["small functions"] / thousand,
        "vague names per 1000": counts["vague"] / thousand,
        "functions over 40 statements": counts["long functions"],
        "functions of complexity over 12, %": counts["complex functions"] * percent_of_functions,
        "bare tuples of three returned, %": counts["tuple functions"] * percent_of_functions,
    }
