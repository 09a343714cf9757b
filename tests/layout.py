"""What every figure must be: each text inside the page, no two over one another, no legend over
data, a unit on every axis."""

from __future__ import annotations

import re

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text


def visible_texts(figure: Figure) -> list[Text]:
    texts = [*figure.texts, *(text for legend in figure.legends for text in legend.get_texts())]
    for axes in filter(lambda own: own.get_visible(), figure.axes):
        texts += [axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks = zip(axis.get_majorticklocs(), axis.get_majorticklabels(), strict=False)
            texts += [label for place, label in ticks if low <= place <= high]
    return [text for text in texts if text.get_visible() and text.get_text().strip()]


def check_units(figure: Figure) -> None:
    labels = [
        text
        for axes in figure.axes
        if axes.get_visible()
        for text in (axes.get_xlabel(), axes.get_ylabel())
        if text
    ]
    for label in labels:
        assert re.search(r"\(.+\)|[µn]m|rad", label), label


def check_texts(figure: Figure) -> None:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    page = figure.bbox
    texts = visible_texts(figure)
    assert not any(axes.get_legend() for axes in figure.axes)
    boxes = [text.get_window_extent(canvas.get_renderer()) for text in texts]
    for text, box in zip(texts, boxes, strict=True):
        assert not re.search(r"(?<!\w)-\d", text.get_text()) or re.fullmatch(
            r"\d{4}-\d\d(-\d\d)?", text.get_text()
        ), text.get_text()
        assert page.x0 - 2 <= box.x0 <= box.x1 <= page.x1 + 2, text.get_text()
        assert page.y0 - 2 <= box.y0 <= box.y1 <= page.y1 + 2, text.get_text()
    straight = [
        (text, box) for text, box in zip(texts, boxes, strict=True) if not text.get_rotation() % 90
    ]
    for i, (one, a) in enumerate(straight):
        for other, b in straight[:i]:
            width = min(a.x1, b.x1) - max(a.x0, b.x0)
            height = min(a.y1, b.y1) - max(a.y0, b.y0)
            assert width <= 1.5 or height <= 1.5, (
                f"{one.get_text()!r} overlaps {other.get_text()!r}"
            )
