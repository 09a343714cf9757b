"""Sentences on a design: the circular tests to run next."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from ldbb_bayes.model.parameter_kinds import DEGREE_NAMES
from ldbb_bayes.report.wording.degeneracy_words import degeneracy_items
from ldbb_bayes.report.wording.effect_names import joined, joined_sizes
from ldbb_bayes.report.wording.fixed_texts import SENTENCES
from ldbb_bayes.report.wording.sentence_file import SentenceFile
from ldbb_bayes.units import counted, ranked, without_slopes

if TYPE_CHECKING:
    from ldbb_bayes.analysis.design import Design, Judged

__all__ = ["design_notes", "design_screen", "design_sentences"]

# Sentences on a design compare it with a design in equal steps of force. For each parameter they
# use a ratio: the uncertainty expected after the recommended design, divided by the uncertainty
# expected after the design in equal steps. The ratios of two parameters count as equal if they
# differ by less than this value.
_EQUAL_RATIOS = 2e-3
_MOST_LISTED_TESTS = 12  # largest number of tests to run that a sentence lists

_TEMPLATES = SentenceFile("design", DEGREES=DEGREE_NAMES)


def design_sentences(design: Design) -> tuple[str, ...]:
    """Return sentences on the tests that a design recommends, followed by notes."""
    ratio = {}
    gain = {}
    for name in without_slopes(design.parameters):
        ratio[name] = design.expected[name].sd / design.baseline[name].sd
        gain[name] = -ratio[name]
    most_improved = ranked(ratio, gain.__getitem__, tolerance=_EQUAL_RATIOS)[0]
    least_improved = ranked(ratio, ratio.__getitem__, tolerance=_EQUAL_RATIOS)[0]
    return _TEMPLATES.sentences(
        "design_sentences",
        design,
        _tests_to_run(design),
        _contrary_designs(design),
        ratio,
        most_improved,
        least_improved,
        design_notes(design),
    )


def design_screen(design: Design) -> tuple[str, ...]:
    """Return the most important sentences on a design of tests. The first lists the tests."""
    tests = _tests_to_run(design, most=len(design.table))
    return _TEMPLATES.sentences("design_screen", design, tests, _contrary_designs(design))


def design_notes(design: Design) -> tuple[str, ...]:
    """Return notes on a design of tests.

    The notes state what the tests cannot show, what would help, and what the design assumes.
    """
    relative_errors = [0.0]
    for expected in design.expected.values():
        if expected.sd > 0.0:
            relative_errors.append(expected.sd_error / expected.sd)
    alike = degeneracy_items(design.limits.degeneracies, design.limits.cures)
    sizes = joined_sizes(design.hyper_um, " ")
    return _TEMPLATES.sentences("design_notes", design, sizes, max(relative_errors), alike)


class _ContraryDesigns(NamedTuple):
    """Names of compared designs with a lower efficiency, but no larger expected uncertainty.

    The efficiency compares designs of equally many tests at known hyper-parameters. An analysis of
    the tests has to estimate the hyper-parameters, and its expected uncertainty includes this.
    """

    as_large: tuple[str, ...]  #: designs with at most as many tests as the recommended design
    larger: tuple[str, ...]  #: designs with more tests than the recommended design


def _contrary_designs(design: Design) -> _ContraryDesigns:
    """Return the compared designs whose efficiency and expected uncertainties seem to disagree."""
    recommended = int(design.table["count"].sum())
    as_large = []
    larger = []
    for other in design.compared:
        if other.efficiency >= design.efficiency or not _leaves_less(other, design):
            continue
        if len(other.tests) > recommended:
            larger.append(other.name)
        else:
            as_large.append(other.name)
    return _ContraryDesigns(tuple(as_large), tuple(larger))


def _leaves_less(other: Judged, design: Design) -> bool:
    """Return whether a compared design is expected to leave less uncertainty of all parameters.

    Only the parameters of interest count.
    """
    return all(other.expected[name].sd < design.expected[name].sd for name in design.parameters)


def _tests_to_run(design: Design, most: int = _MOST_LISTED_TESTS) -> str:
    """Return a string that lists the tests of a design.

    An example is "6 circles: 2 × 36 N and 4 × 742 N". If there are more than ``most`` different
    tests, the string refers to the table of tests.
    """
    table = design.table
    varied = _varied_settings(design)
    tests = []
    for row in table.to_dict(orient="records"):
        settings = []
        for name, template in SENTENCES["places"].items():
            if name in varied and row[name] != "":
                settings.append(template.format(row[name]))
        test = f"{row['count']} × {row['force_N']:.4g} N"
        if varied:
            test += f" ({', '.join(settings)})"
        tests.append(test)
    listed = "see the table"
    if len(tests) <= most:
        listed = joined(tests)
    noun = "more circle" if design.augment else "circle"
    return f"{counted(int(table['count'].sum()), noun)}: {listed}"


def _varied_settings(design: Design) -> list[str]:
    """Return the names of the settings, such as the radius, that differ between a design's tests.

    The angles of both balls are included if a ball is turned from its original position in any
    test.
    """
    table = design.table
    clockings = list(design.columns)[:2]
    others = list(design.columns)[2:]
    varied = [name for name in others if table[name].nunique() > 1]
    if bool((table[clockings] != 0.0).any(axis=None)):
        return clockings + varied
    return varied
