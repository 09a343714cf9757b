"""Texts of figures in another language: titles, legends, and the labels at ticks."""

from __future__ import annotations

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ldbb_bayes.report.annex_translation import annex_translation
from ldbb_bayes.report.figure_translation import translate_figure, translate_ticks
from ldbb_bayes.report.translation import words_of

GERMAN = words_of("de")


def upper(text: str) -> str:
    return text.upper()


def labels_of(figure: Figure) -> list[str]:
    """Return the labels of the vertical axis of the first panel, as they are drawn."""
    FigureCanvasAgg(figure).draw()
    return [label.get_text() for label in figure.axes[0].get_yticklabels()]


def test_named_ticks_are_translated() -> None:
    figure = Figure()
    figure.subplots().set_yticks([0.0, 1.0], ["force", "drift"])
    translate_figure(figure, upper)
    assert labels_of(figure) == ["FORCE", "DRIFT"]


def test_ticks_that_panels_share_are_translated_once() -> None:
    figure = Figure()
    first, _ = figure.subplots(1, 2, sharey=True)
    first.set_yticks([0.0, 1.0], ["force", "drift"])
    translate_figure(figure, lambda text: f"<{text}>")
    assert labels_of(figure) == ["<force>", "<drift>"]


def test_every_line_of_a_title_is_translated() -> None:
    figure = Figure()
    title = figure.suptitle("one\ntwo")
    translate_figure(figure, lambda text: f"<{text}>" if text else "")
    assert title.get_text() == "<one>\n<two>"


def test_a_legend_is_translated() -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0.0, 1.0], label="force")
    legend = axes.legend()
    translate_figure(figure, upper)
    assert [text.get_text() for text in legend.get_texts()] == ["FORCE"]


def test_numbers_at_ticks_have_the_decimal_mark_of_the_language() -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.set_ylim(0.0, 1.0)
    translate_ticks(figure, GERMAN.number)
    labels = labels_of(figure)
    assert "0,2" in labels
    assert not any("." in label for label in labels)


def test_numbers_of_the_annex_have_the_decimal_mark_of_the_language() -> None:
    figure = Figure()
    figure.subplots().set_ylim(0.0, 1.0)
    translation = annex_translation(GERMAN, frozenset())
    assert translation is not None
    translate_figure(figure, translation.text)
    assert "0,2" in labels_of(figure)
