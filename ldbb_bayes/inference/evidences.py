"""Evidences of many models for the readings of one campaign, with or without one of its tests.

The evidence Z(y) is the density of the readings y under a model. Without test r the readings are
y_−r, and ln p(y_r | y_−r) = ln Z(y) − ln Z(y_−r) states how well the other tests predict test r. If
a test is left out, properties of the campaign, such as its reference force, are still computed from
all tests. Only whole tests are left out, because the readings of one circle are not independent.
The readings of a circle share the random shift of the circle's zero and centre (set-up shift) and
its unexplained deviations (discrepancy). φ are the hyper-parameters, such as the standard deviation
of the noise. Nodes are weighted points that represent p(φ | y).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.deprecation import renamed_keyword, warn_of_new_member
from ldbb_bayes.errors import require
from ldbb_bayes.inference.evidence import check_comparable
from ldbb_bayes.inference.evidence_value import Evidence
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import Nodes, compute_nodes
from ldbb_bayes.inference.nodes_without_test import NodesWithoutTest
from ldbb_bayes.inference.related_models import RelatedModels
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.specification import model_to_toml
from ldbb_bayes.model.terms.columns import Hyper
from ldbb_bayes.results import Array, Shown

__all__ = ["Evidences", "leave_one_out", "left_out_log_densities", "report_nothing"]

# Error allowed in a log evidence [nat] that is computed only to decide whether a model is rejected.
# The tolerance of the `Evidences` object is used instead if it is larger.
_ROUGH_TOLERANCE = 0.1
# To predict a test from the other tests, nodes are needed for the campaign without this test. If
# the campaign has at least ``_FEWEST_TESTS`` tests, these nodes are computed from the nodes for all
# tests. With fewer tests, it is as fast to compute them anew.
_FEWEST_TESTS = 16
# Nodes (weighted values of the hyper-parameters) for a campaign without one test may be computed
# from those for all tests. Their error then includes that of the nodes for all tests, which alone
# may reach the error allowed. It may therefore be this multiple of the error allowed. The log
# density of the test given the others is a difference of log evidences from the same nodes, in
# which the common part of the errors cancels.
_BOTH_ERRORS = 2.0


def report_nothing() -> None:
    """Do nothing, in place of a function that reports progress.

    Unlike a lambda, it can be sent to other processes.
    """


class Evidences(Shown):
    """Evidences of models for the readings of one campaign; each of them is computed only once.

    An evidence is computed from nodes. These are weighted points that represent the posterior of
    the hyper-parameters (such as the standard deviation of the noise). If `compare` and `average`
    are given the same object of this class, each of them reuses the nodes that the other has
    computed.

    Parameters
    ----------
    campaign : Campaign
        Campaign with readings.
    tolerance : float
        Error allowed in every log evidence [nat].
    progress : callable, optional
        Function called without arguments each time that the nodes of a model are ready.
    keep_tests : sequence of str, optional
        Names of the tests to keep. Default: all.

    Examples
    --------
    >>> evidences = lb.inference.Evidences(campaign, tolerance=0.1)
    >>> constant, linear = evidences.nodes(lb.HybridModel.first(0), lb.HybridModel.first(1))
    >>> constant.evidence.log_value > linear.evidence.log_value
    True
    >>> len(evidences.computed)
    2
    """

    shown = ("campaign", "tolerance", "computed")

    @renamed_keyword("keep", "keep_tests")
    def __init__(
        self,
        campaign: Campaign,
        *,
        tolerance: float = 1e-2,
        progress: Callable[[], object] = report_nothing,
        keep_tests: Sequence[str] | None = None,
    ) -> None:
        """Prepare the evidences for the readings of a campaign, without computing any of them.

        ``tolerance`` is the error allowed in every log evidence [nat]. ``progress`` is called
        without arguments each time that the evidence of a model is ready. ``keep_tests`` are the
        names of the tests whose readings are used; None stands for all tests.
        """
        self.campaign = campaign
        self.tolerance = tolerance
        self.progress = progress
        self._keep_tests = keep_tests
        self._nodes: dict[str, Nodes] = {}
        self._related_models: dict[str, RelatedModels] = {}
        self._modes: dict[tuple[Hyper, ...], Array] = {}
        self._posteriors: dict[str, HyperPosterior] = {}

    def check_campaign(self, campaign: Campaign) -> None:
        """Raise an `InputError` if a campaign has other readings than those of this object."""
        require(
            campaign.sha256 == self.campaign.sha256,
            f"evidences must be of the campaign {campaign.name or ''}, got those of"
            f" {self.campaign.name or 'another'}. Make them anew: Evidences(campaign).",
        )

    def nodes(self, *models: HybridModel) -> list[Nodes]:
        """Return the quadrature nodes of each model, in the order of the models.

        The evidence of a model is computed from its nodes, which are weighted values of its
        hyper-parameters, such as the standard deviation of the noise. The nodes of equal models are
        computed only once. Models are related if they differ only in the following three ways:

        - how compliances change with force;
        - which alternative explanations of such a change they contain (for example joints that
          deflect under their own load);
        - whether negative compliances are allowed.

        The nodes of related models are derived from the nodes of the largest of these models.
        """
        keys = [model_to_toml(model) for model in models]
        models_by_key = dict(zip(keys, models, strict=True))
        for key in sorted(models_by_key, key=lambda key: _largest_first(models_by_key[key])):
            if key not in self._nodes:
                self._nodes[key] = self._compute_nodes(models_by_key[key])
            self.progress()
        return [self._nodes[key] for key in keys]

    def nodes_unless_rejected(self, below: float, *models: HybridModel) -> list[Nodes]:
        """Return the quadrature nodes of each model, or rough nodes if all models are rejected.

        Nodes are weighted values of the hyper-parameters, from which the log evidence of a model
        follows. If the nodes of all the models are known already, they are returned. Otherwise,
        rough nodes are computed first, with a larger tolerance than that of this object. If every
        log evidence from the rough nodes, plus its error, is at most ``below`` [nat], all models
        are rejected and the rough nodes are returned. Otherwise, the nodes of all models are
        computed to the tolerance of this object. The list `computed` does not contain evidences
        from rough nodes.
        """
        if all(model_to_toml(model) in self._nodes for model in models):
            return self.nodes(*models)
        rough = self._rough.nodes(*models)
        if max(nodes.evidence.log_value + nodes.error for nodes in rough) > below:
            return self.nodes(*models)
        for _ in models:
            self.progress()
        return rough

    def nodes_unless_negligible(self, below: float, model: HybridModel) -> tuple[Nodes, bool]:
        """Return the quadrature nodes of a model, or other nodes that show that it is negligible.

        A model is negligible if its log evidence is at most ``below`` [nat]. If `nodes` would have
        to compute new nodes, and the nodes of a related model show that the model is negligible,
        these nodes are returned with new weights. The second value is then true, and the log
        evidence agrees with that from `nodes` within the tolerance of this object. Of a model that
        is negligible by far, the log evidence may be an upper bound.
        """
        key = model_to_toml(model)
        if key in self._nodes:
            return self._nodes[key], False
        related_models = self._related_models_of(model)
        posterior = self.posterior(model)
        nodes, is_negligible = related_models.nodes_unless_negligible(posterior, below)
        if not is_negligible:
            self._nodes[key] = nodes
        self.progress()
        return nodes, is_negligible

    def empty_copy(self, tolerance: float | None = None) -> Evidences:
        """Return a new, still empty ``Evidences`` object for the same readings.

        The posterior mode of a model's hyper-parameters is found by a search. In the new object,
        the search starts at the mode that this object has found for a model with the same
        hyper-parameters, if there is one. ``tolerance`` is the error allowed in every log evidence
        [nat]; if it is None, the tolerance of this object is used.
        """
        return self._with_modes(tolerance or self.tolerance, self._keep_tests, self._modes)

    def copy(self) -> Evidences:
        """Return an object with the same evidences, to which new evidences are added separately.

        The copy can be sent to another process: it has no function that is called when an evidence
        is ready.
        """
        copied = self._with_modes(self.tolerance, self._keep_tests, self._modes)
        copied._nodes = dict(self._nodes)
        for key, related_models in self._related_models.items():
            copied._related_models[key] = related_models.copy()
        copied._posteriors = dict(self._posteriors)
        return copied

    def without_test(
        self, test: str, tests: Sequence[str], modes: Mapping[tuple[Hyper, ...], Array]
    ) -> Evidences:
        """Return an ``Evidences`` object for the readings of all tests of the campaign but one.

        The object is new, and no evidence has been computed yet. ``test`` is the name of the test
        left out, ``tests`` are the names of all tests. ``modes`` is a dict of modes (maxima) of
        similar posteriors, at which searches for modes start. Its keys are tuples with the names of
        hyper-parameters. A mode is used for models that have exactly the hyper-parameters in its
        key.
        """
        remaining = [name for name in tests if name != test]
        return self._with_modes(self.tolerance, remaining, modes, self.progress)

    def _with_modes(
        self,
        tolerance: float,
        keep_tests: Sequence[str] | None,
        modes: Mapping[tuple[Hyper, ...], Array],
        progress: Callable[[], object] = report_nothing,
    ) -> Evidences:
        """Return a new ``Evidences`` object, in which no evidence has been computed yet.

        ``tolerance`` is the error allowed in every log evidence [nat]; ``keep_tests`` are the names
        of the tests to keep, or None for all tests. ``progress`` is called each time that the
        evidence of a model is ready. ``modes`` holds modes (maxima) of similar posteriors, at which
        searches for modes start; see `without_test`.
        """
        evidences = Evidences(
            self.campaign, tolerance=tolerance, progress=progress, keep_tests=keep_tests
        )
        evidences._modes = dict(modes)
        return evidences

    @cached_property
    def _rough(self) -> Evidences:
        """``Evidences`` object that computes rough evidences from the same readings.

        The error allowed in a rough log evidence is the tolerance of this object or
        ``_ROUGH_TOLERANCE``, whichever is larger [nat].
        """
        rough = self.empty_copy(max(self.tolerance, _ROUGH_TOLERANCE))
        # The models applied to the campaign, and the modes of their posteriors, do not depend on
        # the tolerance (the error allowed in a log evidence) and are used again.
        rough._posteriors = self._posteriors
        return rough

    def posterior(self, model: HybridModel) -> HyperPosterior:
        """Return the posterior density of a model's hyper-parameters; it is made once and kept."""
        key = model_to_toml(model)
        if key not in self._posteriors:
            check_comparable(model, self.campaign)
            bound = BoundModel(model, self.campaign, keep_tests=self._keep_tests)
            near = self._modes.get(bound.hyper_prior.names)
            self._posteriors[key] = HyperPosterior(
                bound, truncated=bound.truncation.active, near=near
            )
        return self._posteriors[key]

    def _compute_nodes(self, model: HybridModel) -> Nodes:
        """Return the quadrature nodes of a model, from those of a related model if possible."""
        return self._related_models_of(model).nodes(self.posterior(model))

    def _related_models_of(self, model: HybridModel) -> RelatedModels:
        """Return the nodes that are shared by all models related to a model.

        For the first model of a group of related models, new nodes are computed. They are then used
        for all models of the group.
        """
        key = _key_of_related_models(model)
        if key not in self._related_models:
            untruncated = self.posterior(model).without_truncation
            self._related_models[key] = RelatedModels(
                compute_nodes(untruncated, self.tolerance), self.tolerance
            )
            self._modes.setdefault(untruncated.bound.hyper_prior.names, untruncated.mode)
        return self._related_models[key]

    @property
    def computed(self) -> list[Evidence]:
        """Evidences of all models for which this object has computed the evidence so far.

        The error allowed in each log evidence is the tolerance of this object. Rough evidences,
        for which a larger error is allowed, are not included.
        """
        return [nodes.evidence for nodes in self._nodes.values()]

    def of(self, *models: HybridModel) -> list[Nodes]:
        """Return the result of `nodes`, which was called ``of`` in version 0.2."""
        warn_of_new_member("Evidences.of", "nodes")
        return self.nodes(*models)

    @property
    def every(self) -> list[Evidence]:
        """Value of `computed`, which was called ``every`` in version 0.2."""
        warn_of_new_member("Evidences.every", "computed")
        return self.computed


def _largest_first(model: HybridModel) -> list[int]:
    """Return a sort key that puts larger models before smaller ones.

    A model is larger if its compliances are polynomials of a higher degree in the force. Of two
    models with equal degree, the one with fewer parameters fixed at zero is larger. If this number
    is equal too, the model with more alternative explanations is larger. Alternative explanations
    are effects that look like a change of compliance with force.
    """
    return [-model.degree, len(model.fixed), -len(model.rivals)]


def _key_of_related_models(model: HybridModel) -> str:
    """Return a key that related models share: the TOML text of what they have in common.

    The text describes a simplified model. Its compliances are constant and may be negative, and it
    has no alternative explanations (effects that look like a change of compliance with force).
    Models with the same text can share the calculation of their nodes.
    """
    constant = model.without("truncation").with_slope_scale(1.0).with_degree(0)
    return model_to_toml(constant.with_rivals())


def leave_one_out(
    nodes_by_model: Mapping[str, Nodes],
    *,
    tolerance: float = 1e-2,
    progress: Callable[[], object] = report_nothing,
) -> dict[str, dict[str, Nodes]]:
    """Return the quadrature nodes of every model for the readings with each test left out in turn.

    Nodes are weighted values of the hyper-parameters, from which the evidence of the model follows.
    The campaign must have at least two tests.

    Parameters
    ----------
    nodes_by_model : mapping of str to Nodes
        Nodes of each model for the readings of all tests. The keys are names of the models.
    tolerance : float
        Error allowed in every log evidence [nat]. Twice this error is allowed where the nodes for
        all tests are used again.
    progress : callable
        Function called without arguments each time that the nodes of one model without one test are
        ready.

    Returns
    -------
    dict of str to dict of str to Nodes
        Nodes of each model without each test. The first key is the name of the model, the second
        key the name of the test left out.
    """
    models = {name: nodes.bound.model for name, nodes in nodes_by_model.items()}
    # The posterior of the hyper-parameters without one test is similar to the posterior with all
    # tests. The search for its mode therefore begins at the mode that was found with all tests.
    modes = {}
    for nodes in nodes_by_model.values():
        modes[nodes.bound.hyper_prior.names] = nodes.posterior.without_truncation.mode
    bound = next(iter(nodes_by_model.values())).bound
    all_tests = Evidences(bound.campaign, tolerance=tolerance, progress=progress)
    # If there are many tests, leaving out one of them hardly changes the posterior of the
    # hyper-parameters. The nodes for all tests are then used again with other weights.
    of_all_tests = {}
    if len(bound.test_names) >= _FEWEST_TESTS:
        for name, nodes in nodes_by_model.items():
            of_all_tests[name] = NodesWithoutTest(nodes, _BOTH_ERRORS * tolerance)
    nodes_without: dict[str, dict[str, Nodes]] = {name: {} for name in nodes_by_model}
    for test in bound.test_names:
        evidences = all_tests.without_test(test, bound.test_names, modes)
        missing = dict(models)
        for name, of_all in of_all_tests.items():
            nodes_from_all = of_all.nodes(evidences.posterior(models[name]), test)
            if nodes_from_all is not None:
                nodes_without[name][test] = nodes_from_all
                del missing[name]
                progress()
        for name, nodes in zip(missing, evidences.nodes(*missing.values()), strict=True):
            nodes_without[name][test] = nodes
    return nodes_without


def left_out_log_densities(
    nodes_by_model: Mapping[str, Nodes], left_out_nodes: Mapping[str, Mapping[str, Nodes]]
) -> dict[str, Array]:
    """Return the log density of the readings of every test given the readings of the other tests.

    ln p(y_r | y_−r) = ln Z(y) − ln Z(y_−r). Here Z(y) is the evidence for the readings of all
    tests, and Z(y_−r) that for the readings of all tests except r. Nodes are weighted values of the
    hyper-parameters, from which an evidence follows. ``nodes_by_model`` is a dict with the nodes
    for Z(y); its keys are the names of the models. ``left_out_nodes`` is a dict of dicts with the
    nodes for Z(y_−r); the first key is the name of the model, the second key the name of test r.
    The result is a dict with the names of the models as keys and an array of shape (tests,) for
    each model. If no test was left out for a model, its array is empty.
    """
    log_densities = {}
    for name, nodes in nodes_by_model.items():
        nodes_by_test = left_out_nodes.get(name, {})
        left_out = [without.evidence.log_value for without in nodes_by_test.values()]
        log_densities[name] = nodes.evidence.log_value - np.array(left_out)
    return log_densities
