"""Description of a fit in words: its state, verdict, misfits and warnings.

The state and the verdict say whether the results of the fit can be used. A misfit is a feature of
the readings that the fitted model does not predict.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ldbb_bayes.analysis.posterior_verdicts import confounded_in
from ldbb_bayes.analysis.verdicts import not_modelled
from ldbb_bayes.campaign.preview import CampaignPreview, check_campaign
from ldbb_bayes.campaign.remarks import RemarkKind
from ldbb_bayes.inference.fit import Fit
from ldbb_bayes.inference.posterior import bound_of, campaign_of, fit_of, record_of
from ldbb_bayes.inference.posterior_cache import cached_by_posterior
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.report import wording
from ldbb_bayes.results import Shown

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["FitWords", "describe_fit", "further_remarks", "words_of_fit"]

# A report on a fit leaves out the remarks on the campaign that have one of these kinds, because
# other sentences of the report state the same facts.
_REMARKS_OF_FITS = (RemarkKind.ONE_LEVEL, RemarkKind.TWO_LEVELS, RemarkKind.ONE_WAY)


class FitWords(Shown, dict[str, Any]):
    """Dictionary that describes a fit in words: its state, verdict, misfits and warnings.

    The state and the verdict say whether the results of the fit can be used. A misfit is a feature
    of the readings that the fitted model does not predict. The function ``print`` shows the
    dictionary as sentences.
    """

    def __repr__(self) -> str:
        """Return a short text with the state of the fit and the number of its warnings."""
        return f"<fit in words: {self['state']}, {len(self['warnings'])} warnings>"


@cached_by_posterior
def describe_fit(posterior: xr.DataTree) -> FitWords:
    """Return a description of a fit in words: its state, verdict, misfits and warnings.

    The state and the verdict say whether the numbers of the fit can be used. A misfit is a feature
    of the readings that the fitted model does not predict.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.

    Returns
    -------
    FitWords
        A dictionary, which the function ``print`` shows as sentences. It has five keys:

        - ``state``: ``usable``, ``doubtful`` or ``unusable``
        - ``kinds``: the kinds of all warnings and misfits
        - ``verdict``: a sentence on whether the numbers can be used
        - ``misfits``: strings that name the misfits
        - ``warnings``: sentences that warn the user

    Examples
    --------
    >>> words = lb.report.describe_fit(posterior)
    >>> words["state"]
    'usable'
    >>> [warning for warning in words["warnings"] if warning.startswith("Confounded")]
    ['Confounded: C_XYX ... with hysteresis; ...']
    """
    return words_of_fit(
        fit_of(posterior),
        record_of(posterior)["sampler"],
        bound_of(posterior),
        confounded_in(posterior),
        check_campaign(campaign_of(posterior)),
    )


def words_of_fit(
    fit: Fit,
    sampler: Mapping[str, Any],
    bound: BoundModel,
    confounded: Mapping[str, Sequence[str]],
    campaign_preview: CampaignPreview,
) -> FitWords:
    """Return a description of a fit in words: its state, verdict, misfits and warnings.

    The state and the verdict say whether the numbers of the fit can be used. A misfit is a feature
    of the readings that the fitted model does not predict.

    Parameters
    ----------
    fit
        Results of the fit: how well the model predicts the readings, and concerns about the fit.
    sampler
        Entry ``sampler`` of a posterior's record, which states how the sampler ran.
    bound
        The model applied to the campaign.
    confounded
        Mapping from the names of the confounded parameters and changes with force to the names of
        the effects with which each of them is confounded (`confounded_in`).
    campaign_preview
        Preview of the campaign, with remarks on what looks odd (`check_campaign`).

    Returns
    -------
    FitWords
        The same as `describe_fit` returns.
    """
    warnings = [
        *wording.concern_sentences(fit.concerns, sampler),
        *wording.check_notes(fit),
        *wording.confounded_sentences(confounded),
        *wording.not_modelled_sentences(not_modelled(bound)),
    ]
    warnings += wording.peculiarity_sentences(campaign_preview)
    warnings += further_remarks(campaign_preview)
    return FitWords(
        state=str(fit.state),
        kinds=list(fit.kinds),
        verdict=wording.fit_verdict(fit),
        misfits=[wording.check_words(check) for check in fit.misfits],
        warnings=warnings,
    )


def further_remarks(campaign_preview: CampaignPreview) -> list[str]:
    """Return those remarks on a campaign that the sentences on its fit do not repeat.

    ``campaign_preview`` holds all remarks on the campaign, which are made without a fit.
    """
    return [
        wording.remark_words(remark)
        for remark in campaign_preview.remarks
        if remark.kind not in _REMARKS_OF_FITS
    ]
