"""What was measured, and what a fit assumed of it."""

from __future__ import annotations

from ldbb_bayes.analysis.preview import TestPreview
from ldbb_bayes.report.document import Bullets, Paragraph, Part, Picture, Section, Sheet, sheet
from ldbb_bayes.report.figures.circles import traces
from ldbb_bayes.report.findings import Findings

__all__ = ["campaign"]

_PLACES = {"plane": "plane", "setup": "set-up", "radius_mm": "R (mm)", "centre_mm": "centre (mm)"}


def campaign(found: Findings) -> Section:
    """Tests, assumptions and remarks."""
    seen = found.seen
    readings = sum(test.readings for test in seen.tests)
    remarks = [f"Look at {test.name}: {remark}." for test in seen.tests for remark in test.remarks] + list(seen.remarks)
    parts: list[Part] = [
        Paragraph(f"{len(seen.tests)} circular tests, {readings} readings. SHA-256 of the readings: {seen.sha256}."),
        _tests(seen.tests),
        Bullets(seen.assumptions),
    ]
    if remarks:
        parts += [Paragraph("Seen in the readings:"), Bullets(tuple(remarks))]
    parts.append(
        Picture(
            "traces",
            f"Polar traces of {len(seen.tests)} circular tests with the prediction of the fit",
            "Readings, prediction (machine and shared nuisances), and the 95 % band for a new circle.",
            traces(found.posterior),
        )
    )
    return Section("campaign", "The campaign", tuple(parts))


def _tests(tests: tuple[TestPreview, ...]) -> Sheet:
    told = [field for field in _PLACES if len({getattr(test, field) for test in tests}) > 1]
    heads = [
        "test", "force (N)", "pressure (bar)", "readings", "arc (°)", "travel", *(_PLACES[field] for field in told),
        "balls (°)", "noise (µm)", "peak to peak (µm)",
    ]  # fmt: skip
    rows = [
        [
            test.name,
            f"{test.force_N:.4g}",
            f"{test.pressure_bar:.3g}",
            str(test.readings),
            f"{test.arc_deg:.0f}",
            test.direction or "not stated",
            *(_place(getattr(test, field)) for field in told),
            f"{test.work_ball_deg:g} / {test.tool_ball_deg:g}",
            _or_dash(test.noise_um),
            _or_dash(test.peak_to_peak_um),
        ]
        for test in tests
    ]
    caption = "Tests. Noise: scatter beyond Fourier order 12; balls: clocking of workpiece and tool ball"
    return sheet(caption, heads, rows, text=(5,))


def _place(value: object) -> str:
    return ", ".join(f"{x:g}" for x in value) if isinstance(value, tuple) else f"{value}".removesuffix(".0")


def _or_dash(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"
