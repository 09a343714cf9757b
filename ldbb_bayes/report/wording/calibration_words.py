"""Sentences on checks by simulation: of credible intervals, and of a Bayesian workflow."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ldbb_bayes.report.wording.sentence_file import SentenceFile

if TYPE_CHECKING:
    from ldbb_bayes.analysis.calibration import Validation
    from ldbb_bayes.analysis.workflow import Workflow

__all__ = ["validation_verdict", "workflow_sentences"]

_TEMPLATES = SentenceFile("calibration")


def validation_verdict(validation: Validation) -> str:
    """Return a sentence on the result of simulation-based calibration.

    The sentence states whether the ranks of true values are uniformly distributed. A rank is the
    number of posterior draws below the true value in a simulated campaign.
    """
    return _TEMPLATES.sentence("validation_verdict", validation)


def workflow_sentences(workflow: Workflow) -> tuple[str, ...]:
    """Return one sentence on each check of a Bayesian workflow, and one on the overall result."""
    return _TEMPLATES.sentences("workflow_sentences", workflow)
