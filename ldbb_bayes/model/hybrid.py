"""HybridModel: the terms, the prior and the noise, before they meet a campaign.

ρ = Σ_k F (F − F0)^k j_C·C_k + j_G·E + nuisances + ε, β = (C_0 …, E) ~ N(m, S), nuisances Gaussian given φ = (σ, δ, κ, τ).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.model.columns import HYPERS, Hyper, Nuisance
from ldbb_bayes.model.prior import Prior, degree_of
from ldbb_bayes.model.terms import (
    BallForm,
    BarLength,
    Compliance,
    Discrepancy,
    Drift,
    ForceError,
    GeometricErrors,
    Hysteresis,
    Mount,
    SetupShift,
)
from ldbb_bayes.notebook import table_html

if TYPE_CHECKING:
    from ldbb_bayes.model.bound import BoundModel
    from ldbb_bayes.model.simulate import Simulation

__all__ = ["NUISANCES", "HybridModel", "Preset"]

Preset = Literal["default", "paper"]
NUISANCES: Mapping[str, type[Nuisance]] = {
    "ball-form": BallForm,
    "bar-length": BarLength,
    "mount": Mount,
    "force-error": ForceError,
    "setup-shift": SetupShift,
    "discrepancy": Discrepancy,
    "hysteresis": Hysteresis,
    "drift": Drift,
}
_ON_DEMAND = ("drift",)


@dataclass(frozen=True)
class HybridModel:
    """The model of a campaign, not yet bound to one.

    Parameters
    ----------
    degree : {0, 1, 2}
        Compliance constant, linear or quadratic in force. Constant is linear with its slopes fixed at zero.
    nuisances : tuple of terms
    prior : Prior
    reference_force_N : float, optional
        F0; default: mid-range of the campaign's forces. F0 = 0 gives Eq. 33 literally.
    preset : {"default", "paper"}
        Where the model started from.
    fixed : tuple of str
        Parameters fixed at zero, for example ``("C_XYX_1",)``; their names are checked when the model meets a campaign.

    Raises
    ------
    InputError
        For a degree other than 0, 1, 2, a nuisance given twice, or a parameter fixed at zero whose prior mean is another.
    """

    degree: int = 1
    nuisances: tuple[Nuisance, ...] = field(default_factory=lambda: _usual())
    prior: Prior = field(default_factory=Prior.default)
    reference_force_N: float | None = None
    preset: Preset = "default"
    fixed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "fixed", tuple(sorted(set(self.fixed))))
        if self.degree not in (0, 1, 2):
            raise InputError(f"degree must be 0, 1 or 2, got {self.degree}. Choose constant, linear or quadratic compliance.")
        if self.reference_force_N is not None and not np.isfinite(self.reference_force_N):
            raise InputError(
                f"reference_force_N must be finite, got {self.reference_force_N}. Give a force in N or leave it out."
            )
        torn = next((name for name in self.fixed if self.prior.means.get(name)), None)
        if torn is not None:
            raise InputError(
                f"{torn} must be fixed at zero or have a prior mean, got both ({self.prior.means[torn]:g}). Remove one of them."
            )
        kinds = [type(term) for term in self.nuisances]
        repeated = next((kind for kind in kinds if kinds.count(kind) > 1), None)
        if repeated is not None:
            raise InputError(f"nuisances must differ, got {repeated.__name__} twice. Remove one.")
        if self.prior.flat and self.nuisances:
            raise InputError(
                f"a flat prior must stand without nuisances, got {kinds[0].__name__}: what they share with the "
                "parameters would be undetermined. Use proper priors or remove the nuisances."
            )

    @classmethod
    def default(cls, degree: int = 1) -> HybridModel:
        """All nuisances, proper priors, truncation."""
        return cls(degree)

    @classmethod
    def paper(cls, degree: int = 0) -> HybridModel:
        """No nuisances, flat priors, no truncation: the point estimate is Eq. 31."""
        return cls(degree, (), Prior.paper(), preset="paper")

    @classmethod
    def from_preset(cls, preset: str, degree: int) -> HybridModel:
        """The named preset."""
        check_known("preset", [preset], ("default", "paper"))
        return cls.paper(degree) if preset == "paper" else cls.default(degree)

    def with_degree(self, degree: int) -> HybridModel:
        """The same model with another degree; what is fixed or overridden stays so where the new degree has it."""
        fixed = tuple(name for name in self.fixed if degree_of(name) <= degree)
        overrides = {name: sd for name, sd in self.prior.overrides.items() if degree_of(name) <= degree}
        return replace(self, degree=degree, fixed=fixed, prior=replace(self.prior, overrides=overrides))

    def with_slope_scale(self, scale: float) -> HybridModel:
        """The same model with slopes of this prior scale; what is overridden changes in proportion."""
        factor = scale / self.prior.slope_scale
        overrides = {name: sd * (factor if degree_of(name) else 1.0) for name, sd in self.prior.overrides.items()}
        return replace(self, prior=replace(self.prior, slope_scale=scale, overrides=overrides))

    def fixing(self, *names: str) -> HybridModel:
        """The same model with the named parameters fixed at zero; a prior mean they had becomes zero."""
        means = {name: 0.0 if name in names else mean for name, mean in self.prior.means.items()}
        return replace(self, fixed=(*self.fixed, *names), prior=replace(self.prior, means=means))

    def including(self, *terms: Nuisance) -> HybridModel:
        """The same model with these nuisances, in place of its own of the same kind: ``including(Drift("temperature"))``."""
        own = {type(term): term for term in (*self.nuisances, *terms)}
        return replace(self, nuisances=tuple(own[kind] for kind in NUISANCES.values() if kind in own))

    def without(self, *names: str) -> HybridModel:
        """The same model without the named terms (``ball-form`` … ``hysteresis``, ``truncation``).

        Raises
        ------
        InputError
            For an unknown name.
        """
        check_known("term", names, (*NUISANCES, "truncation"))
        drop = tuple(NUISANCES[name] for name in names if name != "truncation")
        prior = self.prior.untruncated() if "truncation" in names else self.prior
        return replace(self, nuisances=tuple(term for term in self.nuisances if not isinstance(term, drop)), prior=prior)

    @property
    def hypers(self) -> tuple[Hyper, ...]:
        """Active hyper-parameters; σ always, the others with their term."""
        active = {"sigma", *(name for term in self.nuisances for name in term.hypers)}
        return tuple(name for name in HYPERS if name in active)

    @property
    def terms(self) -> tuple[str, ...]:
        """Class names of all terms."""
        own = (type(Compliance()).__name__, type(GeometricErrors()).__name__)
        return (*own, *(type(term).__name__ for term in self.nuisances))

    def _repr_html_(self) -> str:
        compliance = ("constant", "linear in force", "quadratic in force")[self.degree]
        rows = [
            {"term": type(term).__name__, "settings": ", ".join(f"{k} = {_shown(v)}" for k, v in vars(term).items())}
            for term in self.nuisances
        ]
        prior = "flat" if self.prior.flat else "proper, truncated to physical compliances" if self.prior.truncated else "proper"
        return table_html(
            f"HybridModel: compliance {compliance}; priors {prior}; nuisances", rows or [{"term": "none", "settings": ""}]
        )

    def bind(self, campaign: Campaign) -> BoundModel:
        """The model of this campaign (or plan): columns, reduced readings, likelihood.

        Raises
        ------
        InputError
            For degree ≥ 1 with one force level, or flat priors that the forces leave undetermined.
        """
        from ldbb_bayes.model.bound import BoundModel

        return BoundModel(self, campaign)

    def simulate(
        self,
        plan: Campaign,
        *,
        seed: int,
        parameters: Mapping[str, float] | None = None,
        hyper_um: Mapping[str, float] | None = None,
        exact: bool = False,
    ) -> Simulation:
        """Readings of a plan that this model believes; see `ldbb_bayes.model.simulate.simulate`."""
        from ldbb_bayes.model.simulate import simulate

        return simulate(self, plan, seed=seed, parameters=parameters, hyper_um=hyper_um, exact=exact)


def _usual() -> tuple[Nuisance, ...]:
    return tuple(term() for name, term in NUISANCES.items() if name not in _ON_DEMAND)


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"
