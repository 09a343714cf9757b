"""The messages that the source code of a room writes: notes on files, and reasons for a refusal.

A message is taken from the source as it would read with stand-ins for the values in it.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "ldbb_bayes"
ERRORS = ("InputError", "OpenQuestionError", "NoTableError", "EmptyFileError")
# Arguments of the methods that add a note to a log, counted from 0: without the place.
NOTE_ARGUMENTS = {"add": slice(1, 5), "note": slice(0, 4)}
# Variables that hold the reason of a note, or the place that states a value.
REASONS = ("reason", "source", "contradiction")
# Stand-ins for values, by a part of the expression for the value. The first that fits is used.
STAND_INS = {
    "len(": "4",
    "_middle_row(": "",
    "_advice(": "Check it.",
    "advice_on_positions(": "Check it.",
    "advice": "",
    "as_stated": "",
    "ellipsis": "",
    "hint": "",
    "question": "",
    "limits": "at least 1",
    "wanted": "number",
    "number": "neither",
    "subject": "zero",
    "line": "3",
    "place": "a.csv",
    "path": "a.csv",
    "source": "line 3",
    "_options": "--unit",
    "option": "--unit",
    "flag": "--unit",
    "remedy": "Check it.",
    "role": "reading",
    "content": "reading",
    "LARGEST": "5",
    "_LONGEST": "6",
    "FEWEST": "7",
    "n_": "8",
    "width": "2",
    "size": "1",
    "longer": "positive",
    "sign": "1",
}


def trees(*rooms: str) -> Iterator[ast.Module]:
    """Yield the syntax trees of all modules of rooms, or of single modules."""
    for room in rooms:
        path = PACKAGE / room
        files = [path] if path.is_file() else sorted(path.rglob("*.py"))
        assert files, room
        for file in files:
            yield ast.parse(file.read_text(encoding="utf-8"))


def stand_in(value: ast.FormattedValue) -> str:
    """Return a text that stands for a value in an f-string."""
    if value.conversion == ord("r"):
        return "'x y'"
    if value.format_spec is not None:
        return "1.5"
    expression = ast.unparse(value.value)
    for part, text in STAND_INS.items():
        if part in expression:
            return text
    return "W"


def text_of(node: ast.expr) -> str | None:
    """Return the text of an expression; None if it is no string that stands in the source."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.BinOp):
        pieces = [text_of(node.left), text_of(node.right)]
        return None if None in pieces else "".join(map(str, pieces))
    if not isinstance(node, ast.JoinedStr):
        return None
    text = ""
    for piece in node.values:
        if isinstance(piece, ast.FormattedValue):
            text += stand_in(piece)
        elif isinstance(piece, ast.Constant):
            text += str(piece.value)
    return text


def called(node: ast.Call) -> str:
    """Return the name of the function or method that is called."""
    if isinstance(node.func, ast.Attribute):
        return node.func.attr
    return ast.unparse(node.func)


def notes(*rooms: str) -> set[str]:
    """Return subjects, values, reasons and options of all notes that modules add to a log."""
    texts = set()
    for tree in trees(*rooms):
        for node in ast.walk(tree):
            expressions: list[ast.expr] = []
            if isinstance(node, ast.Call) and called(node) in NOTE_ARGUMENTS:
                if len(node.args) >= 4:
                    expressions = node.args[NOTE_ARGUMENTS[called(node)]]
            elif isinstance(node, ast.Assign):
                names = [ast.unparse(target) for target in node.targets]
                if set(names) & set(REASONS):
                    expressions = [node.value]
            texts |= {text_of(expression) or "" for expression in expressions}
    return texts - {""}


def refusals(*rooms: str) -> set[str]:
    """Return the messages of all errors that modules raise for files and entries."""
    texts = set()
    for tree in trees(*rooms):
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call) or not node.args:
                continue
            message: ast.expr | None = None
            if called(node) in ERRORS:
                message = node.args[0]
            elif called(node) == "require":
                message = node.args[1]
            if message is not None:
                texts.add((text_of(message) or "").rstrip())
    return texts - {""}
