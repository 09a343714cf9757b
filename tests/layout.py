"""What every figure must be: each text inside the page, no two over one another, no legend over
data, a unit on every axis."""

from __future__ import annotations

import re
from itertools import combinations

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox


def visible_texts(figure: Figure) -> list[Text]:
    texts = list(figure.texts)
    for legend in figure.legends:
        texts += legend.get_texts()
    for axes in figure.axes:
        if not axes.get_visible():
            continue
        texts += [axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks = zip(axis.get_majorticklocs(), axis.get_majorticklabels(), strict=False)
            texts += [label for place, label in ticks if low <= place <= high]
    return [text for text in texts if text.get_visible() and text.get_text().strip()]


def check_units(figure: Figure) -> None:
    for axes in figure.axes:
        if not axes.get_visible():
            continue
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert not label or re.search(r"\(.+\)|[µn]m|rad", label), label


def check_texts(figure: Figure) -> None:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    page = figure.bbox
    texts = visible_texts(figure)
    assert not any(axes.get_legend() for axes in figure.axes)
    boxes = [text.get_window_extent(canvas.get_renderer()) for text in texts]
    straight: list[tuple[str, Bbox]] = []
    for text, box in zip(texts, boxes, strict=True):
        words = text.get_text()
        if re.search(r"(?<!\w)-\d", words):
            assert re.fullmatch(r"\d{4}-\d\d(-\d\d)?", words), words
        assert page.x0 - 2 <= box.x0 <= box.x1 <= page.x1 + 2, words
        assert page.y0 - 2 <= box.y0 <= box.y1 <= page.y1 + 2, words
        if text.get_rotation() % 90 == 0:
            straight.append((words, box))
    for (words, box), (other_words, other_box) in combinations(straight, 2):
        assert not overlap(box, other_box), f"{words!r} overlaps {other_words!r}"


def overlap(box: Bbox, other: Bbox) -> bool:
    """Whether two boxes share more than 1.5 px in both directions."""
    width = min(box.x1, other.x1) - max(box.x0, other.x0)
    height = min(box.y1, other.y1) - max(box.y0, other.y0)
    return bool(width > 1.5 and height > 1.5)
