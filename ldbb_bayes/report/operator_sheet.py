"""Sheet for the operator: the next circle to run, and how close the campaign is to its aims.

The aims are goals for uncertainties, decisions on tolerances, and the choice of a model.
"""

from __future__ import annotations

from ldbb_bayes.analysis.design import NextCircle
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.report import wording
from ldbb_bayes.report.html_templates import template_of
from ldbb_bayes.report.next_circle_text import aims_passages

__all__ = ["NAME", "page"]

# name of the file with the sheet that tells the operator the next circle to run
NAME = "sheet.html"


def page(step: NextCircle, plan: Campaign) -> str:
    """Return a sheet for the machine's operator, with the next circle to run, as an HTML page.

    Parameters
    ----------
    step
        The best next circle of a campaign, with the campaign's aims.
    plan
        A plan of tests whose only test is the next circle.

    Returns
    -------
    str
        The page as HTML.
    """
    return template_of("operator.html.j2").render(
        title=f"Circle {step.circles + 1} of {plan.pilot.name if plan.pilot else plan.name}",
        head=wording.next_circle_head(step),
        finished=step.finished,
        settings=_settings(plan),
        passages=aims_passages(step),
    )


def _settings(plan: Campaign) -> list[tuple[str, str]]:
    """Return the settings of the plan's only circle as entries of the operator's sheet.

    Each entry is a tuple of name and text. The texts state the settings with their units. Entries
    that the operator fills in have an empty text.
    """
    test = plan.tests[0]
    force = float(test.force_N or 0.0)
    return [
        ("Force", f"{force:.4g} N"),
        ("Pressure", f"{plan.force_law.pressure_bar(force):.3g} bar"),
        ("Plane", str(test.plane)),
        ("Direction", test.direction or "as before"),
        ("Radius", f"{test.radius_mm:g} mm"),
        ("Work ball turned", f"{test.work_ball_deg:g}°"),
        ("Tool ball turned", f"{test.tool_ball_deg:g}°"),
        ("File", ""),
        ("Time", ""),
        ("Temperature (°C)", ""),
    ]
