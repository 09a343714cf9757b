"""Nodes and evidence of a model, computed at the nodes of a related larger model.

φ are the hyper-parameters, the scales of the noise and of other effects. Nodes are weighted points
that represent p(φ | y), where y are the readings. Related models have the same hyper-parameters:
they differ in slopes, in rival explanations of slopes (effects that look like a change of
compliance with force), and in truncation, which restricts compliances to values that are not
negative. Their posteriors of φ are much alike. The nodes of one of them, weighted by the density of
another, therefore represent the posterior of the other as well.
"""

from __future__ import annotations

from dataclasses import replace

from ldbb_bayes.inference.integrals import in_chunks
from ldbb_bayes.inference.nodes import HyperPosterior, Nodes

__all__ = ["RelatedModels"]


class RelatedModels:
    """Nodes of models whose hyper-parameters are those of a given model.

    Nodes are weighted values of the hyper-parameters φ (scales of the noise and of other effects)
    that represent their posterior. All models share the values of φ. Each model weighs them by its
    own density p(y | φ) p(φ) of the readings y and of φ, as the estimate Ĉ of the compliances,
    about which effects are linearised, is each model's own.

    Parameters
    ----------
    plain : Nodes
        Nodes of the given model, which allows negative compliances. It is the largest of the
        models: the posteriors of φ in the others are at most as wide where these have fewer
        effects.
    tolerance : float
        Error allowed in every log evidence [nat].
    """

    def __init__(self, plain: Nodes, tolerance: float) -> None:
        self._integral = plain.integral
        self._names = plain.bound.hyper_prior.names
        self._tolerance = tolerance

    def nodes(self, posterior: HyperPosterior) -> Nodes:
        """Return the nodes of another model, which are weighted values of its hyper-parameters.

        ``posterior`` is the posterior of the hyper-parameters under that model. The nodes are those
        of the given model with other weights. They are computed anew if the other model has other
        hyper-parameters, or if the error of its log evidence from the given nodes would exceed the
        tolerance.
        """
        if posterior.bound.hyper_prior.names != self._names:
            return posterior.nodes(self._tolerance)
        log_density = in_chunks(posterior.plain.log_density, self._integral.free)
        plain = replace(self._integral, log_density=log_density)
        nodes = Nodes(posterior, plain)
        if posterior.truncated:
            nodes = posterior.truncate(plain, self._tolerance)
        if nodes.meet(self._tolerance):
            return nodes
        return posterior.nodes(self._tolerance)
