"""Preview of a campaign before a fit: its tests, what looks odd, and what a fit will assume."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from ldbb_bayes.campaign.campaign import Campaign, require_campaign
from ldbb_bayes.campaign.campaign_remarks import campaign_remarks
from ldbb_bayes.campaign.circle_preview import TestPreview, preview_test
from ldbb_bayes.campaign.fit_assumptions import fit_assumptions
from ldbb_bayes.campaign.remarks import Remark, RemarkKind
from ldbb_bayes.results import Result

__all__ = ["CampaignPreview", "check_campaign", "preview_of_model"]

# Remarks on what a fit will assume that hold only if the model has a certain term. The values are
# the names of the classes of the terms.
_TERM_OF_REMARK = {
    RemarkKind.BOTH_WAYS: "Hysteresis",
    RemarkKind.DRIFT: "Drift",
    RemarkKind.TEMPERATURES: "Drift",
    RemarkKind.BALLS: "BallForm",
}


@dataclass(frozen=True)
class CampaignPreview(Result):
    """Summary of a campaign before a fit.

    It holds a summary of each test, remarks on what looks odd, and the assumptions that a fit would
    make.
    """

    name: str
    sha256: str
    topology: str
    plane: str
    is_plan: bool
    tests: tuple[TestPreview, ...]
    assumptions: tuple[Remark, ...]
    remarks: tuple[Remark, ...]


def check_campaign(campaign: Campaign) -> CampaignPreview:
    """Return a preview of a campaign or plan without fitting the model.

    The printed preview shows a table of the tests, remarks on what looks odd, and the assumptions
    that a fit would make.

    Parameters
    ----------
    campaign : Campaign
        A campaign or plan.

    Returns
    -------
    CampaignPreview
        Summaries of the ``tests`` with the scatter, resolution and spikes of their readings,
        ``remarks`` on what looks odd, and the ``assumptions`` that a fit would make.

    Examples
    --------
    >>> preview = lb.check_campaign(campaign)
    >>> [str(remark.kind) for remark in preview.remarks]
    ['one way']
    >>> test = preview.tests[0]
    >>> test.name, test.travel, round(test.noise_um, 2), test.spikes
    ('f036', 'CW', 0.12, 0)
    """
    require_campaign(campaign)
    return CampaignPreview(
        name=campaign.name,
        sha256=campaign.sha256,
        topology=campaign.topology,
        plane=campaign.machine().plane,
        is_plan=campaign.is_plan,
        tests=tuple(preview_test(test, campaign) for test in campaign.tests),
        assumptions=fit_assumptions(campaign),
        remarks=campaign_remarks(campaign),
    )


def preview_of_model(preview: CampaignPreview, terms: Collection[str]) -> CampaignPreview:
    """Return a preview without assumptions about terms that a model does not have.

    Parameters
    ----------
    preview
        Preview of a campaign, with the assumptions of the default model.
    terms
        Names of the terms of the model, such as Hysteresis.
    """
    assumptions = []
    for remark in preview.assumptions:
        term = _TERM_OF_REMARK.get(remark.kind)
        if term is None or term in terms:
            assumptions.append(remark)
    return replace(preview, assumptions=tuple(assumptions))
