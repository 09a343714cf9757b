"""Write and execute first_hour.ipynb, draw the README's picture, and write the workbook of the
first tutorial.

pip install nbformat nbclient ipykernel openpyxl
python studies/00_first_hour/make_notebook.py
"""

from __future__ import annotations

import sys
from pathlib import Path

try:
    import nbformat
    from nbclient import NotebookClient
    from openpyxl import Workbook
except ImportError as error:
    sys.exit(
        f"make_notebook: {error.name} must be installed. pip install nbformat nbclient ipykernel"
        " openpyxl"
    )

import ldbb_bayes as lb
from ldbb_bayes.report.figures import traces

HERE = Path(__file__).resolve().parent
ABOUT = (
    ("Machine", "Practice machine"),
    ("Serial number", 4711),
    ("Date", "2026-11-20"),
    ("Operator", "A. Reader"),
    ("Plane", "XY"),
    ("Radius", "150 mm"),
    ("Feed", "2000 mm/min"),
    ("Direction", "clockwise"),
    ("Ball bar", "Practice bar 1"),
)
CELLS = (
    (
        "# The first hour\n\nReadings to credible intervals, on the experiment recovered from the"
        " published tables (what in it is not data stands in"
        " `data/recovered_experiment/README.md`)."
    ),
    (
        "%matplotlib inline\nimport ldbb_bayes as lb\n\ncampaign ="
        " lb.read_campaign(lb.embedded_campaign())\ncampaign"
    ),
    "What is in the campaign, and what looks odd, before anything is fitted:",
    "lb.check_campaign(campaign)",
    "The model: compliance linear in force, and everything that is not the machine.",
    "linear = lb.HybridModel.default(degree=1)\nlinear",
    (
        "Sampling takes a few seconds. The result is an ArviZ DataTree; `summarize` is a pandas"
        " table in mm, N and rad."
    ),
    "posterior = lb.sample(linear, campaign, seed=1)\nlb.summarize(posterior).round(12)",
    "Which of these numbers come from the readings, and which are two names for one thing?",
    "lb.identify(linear, campaign)",
    "from ldbb_bayes.report.figures import traces\n\ntraces(posterior)",
    (
        "from ldbb_bayes.report.figures import"
        " compliance_against_force\n\ncompliance_against_force(posterior)"
    ),
    (
        "Simulated readings of the same plan, with truths of your own, to see what the analysis"
        " returns:"
    ),
    (
        'truth = {"C_XXX": 6e-5, "C_YYY": 4.5e-5, "E_XX1": -1e-4}\n'
        "simulation = linear.simulate(campaign.plan(), seed=2, parameters=truth)\nsimulation"
    ),
)


def main() -> None:
    notebook = nbformat.v4.new_notebook()
    notebook.metadata["kernelspec"] = {
        "name": "python3",
        "display_name": "Python 3",
        "language": "python",
    }
    for number, text in enumerate(CELLS):
        is_code = text.split("\n")[0].startswith(
            ("%", "import", "from", "lb.", "linear =", "posterior =", "{", "truth =")
        )
        cell = nbformat.v4.new_code_cell(text) if is_code else nbformat.v4.new_markdown_cell(text)
        cell["id"] = f"cell-{number}"
        notebook.cells.append(cell)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(HERE)}}).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
    nbformat.write(notebook, HERE / "first_hour.ipynb")

    campaign = lb.read_campaign(lb.embedded_campaign())
    posterior = lb.sample(lb.HybridModel.default(degree=1), campaign, seed=1)
    traces(posterior).savefig(HERE / "traces.png", dpi=110)
    write_workbook(campaign)


def write_workbook(campaign: lb.Campaign) -> None:
    """A sheet about a machine that is made up, and a sheet a circle."""
    book = Workbook()
    book.active.title = "About"
    for row in ABOUT:
        book.active.append(row)
    for test in campaign.tests:
        sheet = book.create_sheet(f"{test.force_N:.0f} N")
        sheet.append(("Angle [°]", "Reading [µm]"))
        for angle, reading in zip(test.angle_deg, test.reading_um, strict=True):
            sheet.append((float(angle), round(float(reading), 2)))
    book.save(HERE.parents[1] / "docs" / "tutorials" / "practice.xlsx")


if __name__ == "__main__":
    main()
