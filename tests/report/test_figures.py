"""Every figure: text inside the page that does not overlap, units on the axes, and values where
they belong."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from campaigns import plan, refuses, simulated
from layout import check_texts, check_units, visible_texts
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from reports import plan_of_three_planes

import ldbb_bayes as lb
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.path_contributions import TOGETHER
from ldbb_bayes.inference.posterior import campaign_of
from ldbb_bayes.report import figures
from ldbb_bayes.report.figures import FIGURES, circle_figures, corner, save_figures
from ldbb_bayes.report.figures.parameter_figures import WORDS
from ldbb_bayes.report.pictures import Picture
from ldbb_bayes.report.text import parts_of
from ldbb_bayes.report.translation import words_of
from ldbb_bayes.units import display_name, display_unit, is_slope, plus_minus, round_uncertainty

QUICK = lb.inference.StoppingRule(ess=100.0, rhat=1.5, lengths=0.2)
LEVELS = tuple(np.linspace(36.0, 742.0, 9))
FORTY = tuple(np.linspace(36.0, 742.0, 40))


# ---- of a posterior


def make(kind: str) -> xr.DataTree:
    if kind == "linear":
        return lb.sample(lb.HybridModel.first(1), simulated(plan()), rule=QUICK)
    if kind == "paper":
        return lb.sample(lb.HybridModel.paper(0), simulated(plan()), rule=QUICK)
    if kind == "forty tests, both ways":
        tests = [
            replace(test, direction=("CW", "CCW")[k % 2])
            for k, test in enumerate(plan([60] * 40, forces_N=FORTY).tests)
        ]
        return lb.sample(
            lb.HybridModel.first(0),
            simulated(replace(plan(), tests=tuple(tests))),
            sampler="independent",
            rule=QUICK,
        )
    if kind == "one test, few readings":
        return lb.sample(
            lb.HybridModel.first(0), simulated(plan((9,), forces_N=(300.0,))), rule=QUICK
        )
    arcs = simulated(plan([30] * 11, forces_N=[50.0 + 60.0 * i for i in range(11)], arc_deg=300.0))
    return lb.sample(lb.HybridModel.first(2), arcs, sampler="independent", rule=QUICK)


@pytest.fixture(
    scope="module",
    params=[
        pytest.param("linear", marks=pytest.mark.slow),
        pytest.param("paper", marks=pytest.mark.slow),
        "one test, few readings",
        pytest.param("eleven arcs, quadratic", marks=pytest.mark.slow),
        pytest.param("forty tests, both ways", marks=pytest.mark.slow),
    ],
)
def posterior(request: pytest.FixtureRequest) -> xr.DataTree:
    return make(request.param)


@pytest.mark.parametrize("name", FIGURES)
def test_texts_and_units(name: str, posterior: xr.DataTree) -> None:
    """Every text inside the page, no two over one another, a unit on every axis, true minus signs;
    settings are left alone."""
    settings = dict(mpl.rcParams)
    figure = FIGURES[name](posterior)
    assert dict(mpl.rcParams) == settings
    check_texts(figure)
    check_units(figure)


def test_crosses_of_circularity_are_whole_circles_at_the_place_of_the_curves() -> None:
    """Of four forces, that of an arc and that of a circle at another centre have no cross."""
    first, arc, elsewhere, last = plan().tests
    tests = (
        first,
        replace(arc, angle_deg=np.linspace(0.0, 200.0, 40)),
        replace(elsewhere, centre_x_mm=80.0, setup=2),
        last,
    )
    campaign = simulated(replace(plan(), tests=tests))
    of_fit = lb.sample(lb.HybridModel.first(0), campaign, sampler="independent", rule=QUICK)
    axes = FIGURES["circularity"](of_fit).axes[0]
    (crosses,) = (line for line in axes.lines if line.get_marker() == "x")
    assert list(crosses.get_xdata()) == [first.force_N, last.force_N]


def test_rings_are_labelled_with_their_distance_and_forces_in_their_order(
    posterior: xr.DataTree,
) -> None:
    """A ring's label is its radius less that of the dashed circle [µm]; the scale has every force,
    as the traces lie, in colours that grow darker with force and stand out from paper in grey."""
    traces, scale = FIGURES["traces"](posterior).axes
    (nominal,) = {
        float(line.get_ydata()[0])
        for line in traces.lines
        if line.is_dashed() and line.get_color() == "black"
    }
    labels = [text for text in traces.texts if text.get_text()]
    stated_um = [float(text.get_text().removesuffix(" µm").replace("−", "-")) for text in labels]
    assert [text.get_position()[1] - nominal for text in labels] == pytest.approx(stated_um)
    assert labels[-1].get_text().endswith(" µm")
    tests = campaign_of(posterior).tests
    forces = sorted({test.force_N for test in tests})
    named = [float(label.get_text()) for label in scale.get_yticklabels()]
    assert len(scale.patches) == len(forces)
    assert len(named) <= 9
    mean = {}
    for force in forces:
        means_of_tests = [np.mean(test.reading_um) for test in tests if test.force_N == force]
        mean[force] = np.mean(means_of_tests)
    upwards = sorted(zip(scale.get_yticks(), named, strict=True))
    extremes = sorted([forces[0], forces[-1]], key=mean.__getitem__)
    assert [upwards[0][1], upwards[-1][1]] == extremes
    colours = np.array(figures.force_colours(forces))
    grey = colours[:, :3] @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(grey) < 0.0).all()
    assert max(grey) < 0.65


def test_readings_far_above_zero_are_drawn_without_the_nominal_circle() -> None:
    """A zero reading would lie beyond the centre; rings and dots keep their place."""
    base = simulated(plan((40,) * 3, forces_N=(36.0, 400.0, 742.0)))
    tests = []
    for test in base.tests:
        tests.append(test.with_reading_um(np.asarray(test.reading_um) + 1000.0))
    far = replace(base, tests=tuple(tests))
    posterior = lb.sample(lb.HybridModel.paper(0), far, sampler="independent", rule=QUICK)
    figure = figures.traces(posterior)
    traces = figure.axes[0]
    assert not [line for line in traces.lines if line.is_dashed()]
    for line in traces.lines:
        assert np.min(line.get_ydata()) > 0.0
    assert "(dashed)" not in traces.get_title()
    check_texts(figure)


@pytest.mark.parametrize("count", [2, 3])
def test_traces_of_several_planes_use_the_width_of_a_sheet(count: int) -> None:
    """Circles are higher than two thirds of the figure, and what explains them reaches the right
    edge or stands in one line above."""
    planned = plan_of_three_planes()
    planes = ("XY", "YZ", "ZX")[:count]
    tests = tuple(test for test in planned.tests if test.plane in planes)
    model = lb.HybridModel.first(0)
    tree = lb.sample(
        model, simulated(replace(planned, tests=tests)), sampler="independent", rule=QUICK
    )
    figure = figures.traces(tree)
    check_texts(figure)
    assert [axes.get_title(loc="left") for axes in figure.axes[:-1]] == [
        f"plane {plane}" for plane in planes
    ]
    assert min(axes.get_position().height for axes in figure.axes[:-1]) > 2.0 / 3.0
    assert figure.axes[count - 1].get_position().x1 > 0.28 * count
    (explanation,) = figure.texts
    assert "dots: readings" in explanation.get_text()


def test_labels_of_forces_on_narrow_panels_stand_apart() -> None:
    """Of three planes there are twelve panels, five in a row; labels read "100200300400500"."""
    planned = plan_of_three_planes()
    forces_N = sorted({test.force_N for test in planned.tests})
    between_N = np.linspace(50.0, 500.0, len(forces_N))
    tests = [
        replace(test, force_N=between_N[forces_N.index(test.force_N)], pressure_bar=None)
        for test in planned.tests
    ]
    model = lb.HybridModel.first(0)
    campaign = simulated(replace(planned, tests=tuple(tests)))
    tree = lb.sample(model, campaign, sampler="independent", rule=QUICK)
    figure = figures.compliance_against_force(tree)
    figure.canvas.draw()
    assert len(figure.axes) > 8
    for axes in figure.axes:
        labels = [label for label in axes.get_xticklabels() if label.get_text()]
        boxes = [label.get_window_extent() for label in labels]
        for left, right in itertools.pairwise(boxes):
            assert left.x1 + 2.0 < right.x0


@pytest.mark.slow
def test_figures_say_the_numbers_of_the_tables(posterior: xr.DataTree) -> None:
    """Intervals and texts of the forest are those of the summary and of the changes with force;
    peaks to peak above the contributions those of their table."""
    table = lb.summarize(posterior)
    names_drawn = []
    for name, entry in lb.analysis.change_with_force(posterior).items():
        change = {**entry.change.as_dict(), "unit": entry.unit}
        table.loc[f"Δ{name}"] = pd.Series(change).reindex(table.columns)
    for axes in FIGURES["forest"](posterior).axes:
        names = [label.get_text().replace("(0Y)", "0Y") for label in axes.get_yticklabels()]
        factor, unit = display_unit(str(table.loc[names[0], "unit"]))
        assert axes.get_xlabel().endswith(f" ({unit})")
        assert axes.get_xlabel().startswith("change from " if names[0][0] == "Δ" else "value ")
        names_drawn += names
        bars = [line.get_xdata() for line in axes.lines if line.get_linewidth() == 1.4]
        for name, bar, text in zip(names, bars, axes.texts, strict=True):
            row = table.loc[name]
            assert bar == pytest.approx(row[["ci_low", "ci_high"]].to_numpy(float) * factor)
            assert text.get_text() == plus_minus(
                row["mean"], row["sd"], (row["ci_low"], row["ci_high"]), row["unit"]
            )
    assert set(names_drawn) == {
        name for name in table.index if name[0] in "CEΔ" and not is_slope(name)
    }
    swings = lb.analysis.decompose_deviation(posterior).set_index("source")
    contributions = FIGURES["contributions"](posterior).axes[-1]
    above = {TOGETHER: contributions.get_title().split(": ")[1]}
    for axes in FIGURES["parameter_contributions"](posterior).axes:
        name, text = axes.get_title().split("\n")
        above[name.replace("(0Y)", "0Y")] = text
    for source, text in above.items():
        expected = swings.loc[source, ["peak_to_peak", "ci_low", "ci_high"]].to_numpy(float)
        stated = [float(number) for number in re.findall(r"[\d.]+", text)]
        assert stated == pytest.approx(expected, abs=0.15 * (expected[2] - expected[1])), source
    assert len(above) >= len(swings) - 2


def test_bands_of_figures_say_that_they_are_of_95_percent(posterior: xr.DataTree) -> None:
    """Whatever the probability of the intervals in brackets of a report is."""
    for name in set(FIGURES) - {"traces", "residuals", "corner"}:
        texts = " ".join(text.get_text() for text in visible_texts(FIGURES[name](posterior)))
        assert "95 %" in texts, name


def test_another_language(posterior: xr.DataTree) -> None:
    """All words of the sheets' figures can be said otherwise."""
    words_by_key = {key: f"<{key}>" for key in WORDS}
    for draw in (figures.traces, figures.compliance_against_force):
        texts = visible_texts(draw(posterior, words=words_by_key))
        words = " ".join(text.get_text() for text in texts)
        assert not re.search(r"[a-z]{4,}", re.sub(r"<[^>]*>|rad", "", words)), words


@pytest.mark.slow
def test_saved_in_both_formats_in_the_unit_of_the_tables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compliances near 5e-5 mm/N read 50 nm/N in figures."""
    two = {name: FIGURES[name] for name in ("forest", "compliance_against_force")}
    monkeypatch.setattr("ldbb_bayes.report.figures.figure_set.FIGURES", two)
    model = lb.HybridModel.first(0)
    tree = lb.sample(model, simulated(plan()), sampler="independent", rule=QUICK)
    written = save_figures(tree, tmp_path / "figures")
    assert len(written) == 4
    assert all(path.stat().st_size > 3000 for path in written)
    for name in two:
        text = (tmp_path / "figures" / f"{name}.svg").read_text()
        assert text.startswith("<?xml")
        assert "nm/N" in text
        assert "µm/N" not in text


@pytest.mark.parametrize("extension", ["png", "svg", "pdf"])
def test_a_figure_always_gives_the_same_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, extension: str
) -> None:
    contents = []
    for day in (1, 2):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", str(86_400 * day))
        figure = Figure()
        figure.subplots().plot([1.0, 2.0], label="°")
        (path,) = lb.figures.save_figure(figure, tmp_path, "line", formats=[extension])
        contents.append(path.read_bytes())
    assert contents[0] == contents[1]
    assert b"CreationDate" not in contents[0]


def test_coordinates_of_pictures_are_rounded() -> None:
    figure = Figure(figsize=(1.0, 1.0), dpi=72)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set(xlim=(0.0, 72.0), ylim=(72.0, 0.0))
    axes.plot([10.0, 11.4567, 50.5], [20.0, 22.2389, 33.0])
    svg = Picture("line", "A line", figure).svg
    assert re.search(r"M 10 20 \s*L 11\.46 22\.24 \s*L 50\.5 33", svg)


def test_choice_of_parameters(posterior: xr.DataTree) -> None:
    assert len(corner(posterior, ["C_XXX", "sigma"]).axes) == 4
    refuses("Did you mean 'C_XXX'", corner, posterior, ["C_XXx"])


def test_atlases_are_tables_2_and_3() -> None:
    machine = lb.Machine("wCAFYXZSt")
    figure = figures.compliance_atlas(machine)
    titles = [axes.get_title() for axes in figure.axes if axes.get_visible()]
    assert len(titles) == 18
    assert sum("no effect" in title for title in titles) == 5
    assert sum(axes.title.get_fontweight() == "bold" for axes in figure.axes) == 6
    assert len([axes for axes in figures.geometric_atlas(machine).axes if axes.get_visible()]) == 7


# ---- of analyses


def texts_of(figure: Figure) -> set[str]:
    """All texts of a figure."""
    figure.canvas.draw()
    texts = set()
    for axes in figure.axes:
        texts |= {axes.get_title(), axes.get_xlabel(), axes.get_ylabel()}
        texts |= {label.get_text() for label in axes.get_yticklabels()}
        texts |= {label.get_text() for label in axes.get_xticklabels()}
        texts |= {text.get_text() for text in axes.texts}
    return texts


@pytest.mark.slow
@pytest.mark.parametrize("model", [lb.HybridModel.first(2), lb.HybridModel.paper(0)])
def test_identifiability_shows_every_parameter(model: lb.HybridModel) -> None:
    identifiability = lb.identify(model, simulated(plan()))
    texts = texts_of(figures.prior_and_posterior(identifiability))
    for name in identifiability.parameters:
        assert any(text.startswith(name.replace("E_C0YX", "E_C(0Y)X") + ":") for text in texts)


@pytest.mark.slow
def test_comparisons(compared: Comparison) -> None:
    figure = figures.evidence(compared)
    check_texts(figure)
    assert {
        "as in the model",
        "without discrepancy",
        "slope scale 0.03",
        "ln B(linear/constant) (nat)",
    } <= texts_of(figure)
    places = []
    for axes in figure.axes:
        for line in axes.lines:
            if line.get_marker() == "o":
                places += [float(x) for x in line.get_xdata()]
    variants = (*compared.prior_sensitivity, *compared.discrepancy_sensitivity)
    expected = sorted(variant.log_bayes_factor for variant in variants)
    assert sorted(places) == pytest.approx(expected)
    limits = [axes.get_xlim() for axes in figure.axes]
    assert all(axes.get_xscale() == "linear" for axes in figure.axes)
    assert all(high < low for (_, high), (low, _) in itertools.pairwise(limits))
    figure = figures.compliance_with_local_fits(compared)
    assert {"C_XXX (nm/N)", "C_CCY (µrad/(N m))", "force (N)"} <= texts_of(figure)
    local = compared.local_fits[compared.local_fits["parameter"] == "C_XYX"]
    crosses = [
        line.get_ydata()
        for line in figure.axes[1].lines
        if line.get_label() == "local, least squares"
    ]
    np.testing.assert_allclose(crosses[0], local["least_squares"] * 1e6)
    assert {"E_XX1 (µm/m)", "E_C(0Y)X (µrad)", "E_Yt0 (µm)"} <= texts_of(
        figures.geometry_with_local_fits(compared)
    )
    bare = replace(
        compared,
        slopes={},
        slope_subsets=(),
        compliance_against_force={},
        tests={},
        prior_sensitivity=(),
    )
    bare = replace(bare, local_fits=pd.DataFrame())
    for draw in (
        figures.evidence,
        figures.compliance_with_local_fits,
        figures.geometry_with_local_fits,
    ):
        texts_of(draw(bare))


@pytest.mark.parametrize(("of_estimate", "size"), [(True, "/ C"), (False, "/ prior sd of C")])
def test_the_title_says_of_what_a_slope_scale_is_a_multiple(
    compared: Comparison, of_estimate: bool, size: str
) -> None:
    figure = figures.evidence(replace(compared, slopes_of_estimate=of_estimate))
    assert figure._suptitle.get_text().splitlines()[0].endswith(size)


def test_the_title_of_local_fits_fits_the_figure(compared: Comparison) -> None:
    figure = figures.geometry_with_local_fits(compared)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    title = figure._suptitle.get_window_extent(canvas.get_renderer())
    assert title.x0 >= 0.0
    assert title.x1 <= figure.bbox.x1


def test_tables_of_a_comparison(compared: Comparison) -> None:
    models, assumptions, slopes, tests, *_ = parts_of(compared)
    value = compared.log_bayes_factor["linear/constant"]
    error = compared.log_bayes_factor_error["linear/constant"]
    assert models.rows[1][1:3] == (f"{value:+.3f}", f"{error:.1g}")
    assert len(assumptions.rows) == 12 + len(compared.discrepancy_sensitivity)
    assert (len(slopes.rows), len(tests.rows)) == (6, 6)


@pytest.mark.slow
@pytest.mark.usefixtures("few_states")
@pytest.mark.parametrize("kind", ["proper", "flat"])
def test_figures_of_designs(kind: str) -> None:
    pilot = simulated(plan(), seed=2)
    if kind == "flat":
        design = lb.design(lb.HybridModel.paper(1), plan(), tests=5, forces_N=LEVELS)
    else:
        design = lb.design(
            lb.HybridModel.first(1), pilot, tests=6, forces_N=LEVELS, against={"own": pilot}
        )
    today = {name: 2.0 * expected.sd for name, expected in design.expected.items()}
    for figure, first in (
        (figures.expected_widths(design), 0),
        (figures.expected_widths(design, today), 1),
    ):
        check_texts(figure)
        (axes,) = figure.axes
        texts = {text.get_text() for text in axes.texts}
        parameters = [name for name in design.expected if not is_slope(name)]
        for k, name in enumerate(parameters):
            expected = design.expected[name]
            factor, unit = display_unit(expected.unit)
            lengths = np.array([bars[k].get_width() for bars in axes.containers])
            sizes = np.array([today[name], expected.sd, design.baseline[name].sd])[1 - first :]
            relative_lengths = lengths[: len(sizes)] / lengths[first]
            assert relative_lengths == pytest.approx(sizes / expected.sd)
            assert {round_uncertainty(expected.sd * factor)[0]} < texts
            assert any(text.startswith(f"{display_name(name)} ({unit})") for text in texts)


def test_verdicts_are_drawn_from_what_identify_returns() -> None:
    refuses(
        r"got DataTree. Give lb.figures.prior_and_posterior\(lb.identify",
        figures.prior_and_posterior,
        xr.DataTree(),
    )


@pytest.mark.parametrize("language", ["en", "de"])
def test_what_dots_lines_and_bands_mean_fits_in_one_line(language: str) -> None:
    words = words_of(language).table["figures"]
    marks = [words["some_readings"].format(every=9), words["prediction"], words["band"]]
    assert len(circle_figures._lines_of_marks(marks, circle_figures._CHARACTERS[1])) == 1


def test_a_line_of_marks_ends_between_two_marks() -> None:
    marks = ("dots: readings", "lines: prediction", "shaded: 95 % for a new circle")
    assert circle_figures._lines_of_marks(marks, 40) == [
        "dots: readings, lines: prediction,",
        "shaded: 95 % for a new circle",
    ]


def test_a_mark_that_is_too_long_is_broken_between_words() -> None:
    assert circle_figures._lines_of_marks(("a long mark", "b"), 7) == ["a long", "mark, b"]
