"""Quantities that the test certificate states, with the verdicts on how far each is determined.

Compliances and circular deviations are stated at one force. A quantity is confounded with another
parameter or effect if both change the readings in the same way. The other parameter or effect is
called a partner of the quantity.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd

from ldbb_bayes.analysis.circularity import predict_circularity
from ldbb_bayes.analysis.compliance_change import change_with_force
from ldbb_bayes.analysis.directional_stiffness import stiffness
from ldbb_bayes.analysis.measured_paths import FULL_CIRCLE_DEG, measure_circularity
from ldbb_bayes.analysis.posterior_verdicts import judge_at_force
from ldbb_bayes.analysis.stated_quantities import HARDLY_POSITIVE
from ldbb_bayes.analysis.tilt_levers import largest_lever_mm
from ldbb_bayes.analysis.usability import Judgement, Use, judge_certificate, undetermined_parameters
from ldbb_bayes.inference.force_curves import draws_at
from ldbb_bayes.inference.posterior import bound_of, fit_of
from ldbb_bayes.inference.posterior_concerns import limits_of_compliances_near_zero
from ldbb_bayes.inference.summary import interval_numbers
from ldbb_bayes.model.campaign_setting import geometric_errors_of
from ldbb_bayes.model.terms import BarLength
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.stated_circle import circle_phrase, tests_of_stated_circle
from ldbb_bayes.report.stated_quantity import StatedQuantity
from ldbb_bayes.report.stiffness_numbers import stiffness_quantities
from ldbb_bayes.report.translation import Words
from ldbb_bayes.report.wording.number_words import SURE
from ldbb_bayes.units import display_name, is_slope, three_digits

if TYPE_CHECKING:
    from ldbb_bayes.analysis.compliance_change import ChangeWithForce
    from ldbb_bayes.analysis.directional_stiffness import DirectionalStiffness, PlaneStiffness
    from ldbb_bayes.analysis.verdicts import ParameterIdentifiability
    from ldbb_bayes.campaign.campaign import Campaign
    from ldbb_bayes.model.hybrid import BoundModel

__all__ = ["SheetNumbers"]

# Table for ``str.translate`` that replaces the letter of a rotation (A, B or C) by the letter of
# the axis about which it turns (X, Y or Z).
_ROTATED_AXIS = str.maketrans("ABC", "XYZ")
_SHEET_1_KINDS = ("squareness",)


@dataclass(frozen=True, eq=False)
class SheetNumbers:
    """All quantities that the sheets of the test certificate state.

    Parameters
    ----------
    findings
        All results of the fit that the report shows.
    words
        Texts of the test certificate, in its language.
    force_N
        Force at which compliances and circular deviations are stated [N].
    """

    findings: Findings
    words: Words
    force_N: float

    @cached_property
    def parameters(self) -> dict[str, StatedQuantity]:
        """Compliances at the force ``force_N``, and geometric errors, by their names.

        Offsets of the tool ball are left out. Slopes (coefficients of the change with force) are
        left out, too; `changes` holds the changes themselves.
        """
        return {
            name: stated
            for name, stated in self._parameters_and_slopes.items()
            if not is_slope(name)
        }

    @cached_property
    def verdicts(self) -> Mapping[str, ParameterIdentifiability]:
        """Verdicts on the parameters, with the compliances at the force ``force_N``."""
        return judge_at_force(self.findings.posterior_of_certificate, self.force_N)

    @cached_property
    def judgement(self) -> Judgement:
        """Whether the values on the certificate can be used, and the reasons against their use."""
        comparison = None
        if not isinstance(self.findings.comparison, str):
            comparison = self.findings.comparison
        return judge_certificate(
            fit_of(self.findings.posterior),
            self.verdicts,
            self.parameters,
            comparison=comparison,
            rough_weights=self.findings.has_rough_weights,
        )

    @property
    def are_unusable(self) -> bool:
        """Whether the values on the certificate must not be used."""
        return self.judgement.use == Use.DO_NOT_USE

    @cached_property
    def slopes(self) -> dict[str, StatedQuantity]:
        """Slopes, that is, coefficients of the change of compliances with force.

        The keys of the dict are the names of the slopes. Slopes without a tolerance are not shown
        on the test certificate.
        """
        return {
            name: stated for name, stated in self._parameters_and_slopes.items() if is_slope(name)
        }

    @cached_property
    def changes(self) -> dict[str, StatedQuantity]:
        """Changes of the compliances C(F) from the smallest to the largest force tested.

        The keys are the names of the compliances.
        """
        stated = {}
        for name, change in self.changes_with_force.items():
            if_any = None
            if change.if_any is not None:
                if_any = change.if_any.interval
            stated[name] = StatedQuantity(
                words=self.words(
                    "quantities.change",
                    symbol=display_name(name),
                    low=self.words.number(f"{change.smallest_force_N:.4g}"),
                    high=self.words.number(f"{change.largest_force_N:.4g}"),
                ),
                symbol=f"Δ{display_name(name)}",
                estimate=change.change.mean,
                sd=change.change.sd,
                interval=change.change.interval,
                unit=change.unit,
                direction=_direction_of_change(change),
                change_entry=self.findings.change_verdicts.get(name),
                no_change=change.probability_of_no_change,
                if_any=if_any,
            )
        return stated

    @cached_property
    def changes_with_force(self) -> Mapping[str, ChangeWithForce]:
        """Change C(F_max) − C(F_min) of each compliance between the smallest and largest force.

        F_min and F_max are the smallest and the largest force tested [N]. The mapping holds one
        object for each compliance; the keys are the names of the compliances. Each object states
        the change, the compliances at both forces, and the credible intervals of these values, all
        in the internal unit of the compliance, such as mm/N. It also states the probability that
        the compliance grows with the force.
        """
        return change_with_force(self.findings.posterior_of_certificate, prob=self.findings.prob)

    @cached_property
    def planes(self) -> tuple[str, ...]:
        """Planes that were tested, such as XY."""
        return tuple(plane.plane for plane in self._directional.planes)

    @property
    def stiffness_by_plane(self) -> Sequence[PlaneStiffness]:
        """Stiffness by direction at the force ``force_N``: one object for each tested plane."""
        return self._directional.planes

    def stiffness_of_axis(self, axis: str) -> StatedQuantity | None:
        """Return the stiffness of a linear axis, such as X.

        Return None if the model has no direct compliance of this axis.
        """
        for compliance in bound_of(self.findings.posterior_of_certificate).compliances:
            if compliance.kind == "direct" and compliance.joint == axis:
                return self.stiffnesses[compliance.label]
        return None

    @cached_property
    def reversal_coefficients(self) -> dict[str, Mapping[str, float]]:
        """Coefficients of sin 2θ in the model term `Hysteresis`, one for each plane (the key).

        θ is the angle of the bar. Each coefficient is half the amplitude of sin 2θ in the
        difference between the readings of two circles that are run in opposite directions. Planes
        in which all circles were run in the same direction are left out.
        """
        tests = bound_of(self.findings.posterior).campaign.tests
        coefficients = self.findings.result["nuisances"]
        reversal_coefficients = {}
        for plane in self.planes:
            directions = {str(test.direction) for test in tests if test.plane == plane}
            suffix = f"_{plane}" if len(self.planes) > 1 else ""
            name = f"hysteresis{suffix}_sin2"
            if len(directions) > 1 and name in coefficients:
                reversal_coefficients[plane] = coefficients[name]
        return reversal_coefficients

    @cached_property
    def _parameters_and_slopes(self) -> dict[str, StatedQuantity]:
        """Compliances, slopes (coefficients of the change with force) and geometric errors.

        Offsets of the tool ball are left out. The keys of the dict are the names of the parameters.
        """
        bound = bound_of(self.findings.posterior_of_certificate)
        names = _names_by_label(bound)
        undetermined = undetermined_parameters(self.verdicts)
        beta = np.stack([self._draws[name] for name in bound.names], axis=-1)
        limits = limits_of_compliances_near_zero(bound, beta)
        stated = {}
        for parameter in bound.parameters:
            name = names[parameter.compliance]
            if name.kind == "offset":
                continue
            summary = self._summaries[parameter.name]
            stated[parameter.name] = StatedQuantity(
                words=self._quantity_words(name, parameter.degree),
                symbol=display_name(parameter.name),
                estimate=summary["mean"],
                sd=summary["sd"],
                interval=(summary["ci_low"], summary["ci_high"]),
                unit=parameter.unit,
                entry=self.verdicts.get(parameter.name),
                limit_near_zero=limits.get(parameter.name),
                is_undetermined=parameter.name in undetermined,
            )
        return stated

    @cached_property
    def _draws(self) -> Mapping[str, Any]:
        """Random draws from the posterior of each parameter, in internal units (mm, N, rad).

        The draws of a compliance C(F) are values of C at the force ``force_N``. The keys of the
        mapping are the names of the parameters.
        """
        return draws_at(self.findings.posterior_of_certificate, self.force_N)

    @cached_property
    def _summaries(self) -> dict[str, Mapping[str, float]]:
        """The posterior mean, sd, median and credible interval of each parameter.

        The keys are the names of the parameters. Each value is a mapping with the numbers of one
        parameter, in mm, N and rad.
        """
        prob = self.findings.prob
        return {name: interval_numbers(draws, prob) for name, draws in self._draws.items()}

    def _quantity_words(self, name: Any, degree: int) -> str:
        """Return the name of a parameter in words, in the language of the test certificate.

        ``name`` is an object whose attributes are the parts of the name of a compliance or
        geometric error, such as the axis. If ``degree`` is 0, the parameter itself is named. If it
        is 1 or 2, the slope or the curvature of the parameter's change with force is named.
        """
        key = str(name.kind)
        if degree == 1:
            key = "slope"
        elif degree > 1:
            key = "curvature"
        twist = str(getattr(name, "twist", ""))
        wrench = str(getattr(name, "wrench", ""))
        return self.words(
            f"quantities.{key}",
            axis=str(getattr(name, "axis", "") or getattr(name, "joint", "")),
            component=str(getattr(name, "component", "")),
            reference=str(getattr(name, "reference", "")),
            moved=twist.translate(_ROTATED_AXIS),
            load=wrench.translate(_ROTATED_AXIS),
            symbol=display_name(name.label),
        )

    @cached_property
    def stiffnesses(self) -> dict[str, StatedQuantity]:
        """Stiffness 1 / C of every axis, where C is the median of the axis's direct compliance.

        The keys of the dict are the labels of the compliances, such as ``C_XXX``. If the lower end
        of a compliance's credible interval is below a fifth of the median, only a lower limit of
        the stiffness is stated.
        """
        stated = {}
        for compliance in bound_of(self.findings.posterior_of_certificate).compliances:
            if compliance.kind == "direct":
                stated[compliance.label] = self._stiffness(compliance)
        return stated

    def _stiffness(self, compliance: Any) -> StatedQuantity:
        """Return the stiffness 1 / C for a direct compliance C.

        The stiffness has a value and an uncertainty if the credible interval of C begins above a
        fifth of the median of C. Otherwise only a lower limit is stated, which is the stiffness at
        the upper end of the interval. If the upper end is not positive, no stiffness is stated.
        """
        summary = self._summaries[compliance.label]
        median = summary["median"]
        low = summary["ci_low"]
        high = summary["ci_high"]
        smallest = HARDLY_POSITIVE * median
        limit = ""
        sd = np.nan
        if low > smallest > 0.0:
            # Replace the few draws of the compliance C that are near zero by a larger value.
            # Without this step, these draws would dominate the standard deviation of 1 / C.
            draws = np.maximum(self._draws[compliance.label], 0.5 * smallest)
            sd = float(np.std(1.0 / draws))
        elif high > 0.0:
            limit = self.words("quantities.at_least", value=three_digits(1e-3 / high))
        else:
            limit = "–"
        return StatedQuantity(
            words=self.words("quantities.stiffness", axis=compliance.joint),
            symbol=f"1 / {compliance.label}",
            estimate=1.0 / median,
            sd=sd,
            interval=(1.0 / high, 1.0 / low),
            unit="N/mm",
            entry=self.verdicts.get(compliance.label),
            limit=limit,
            note=self._place_of_compliance(compliance.joint),
        )

    def _place_of_compliance(self, axis: str) -> str:
        """Return a remark that says where the direct compliance of ``axis`` is that of the machine.

        The remark is empty if no tilt of the axis acts at the centres of the circles.
        """
        bound = bound_of(self.findings.posterior_of_certificate)
        distance_mm = largest_lever_mm(bound, axis)
        if distance_mm == 0.0:
            return ""
        frame_mm = bound.campaign.machine().joint(axis).frame_mm
        place = "remarks.at_frame" if any(frame_mm) else "remarks.at_zero"
        return self.words(place, axis=axis, distance=self.words.number(f"{distance_mm:.4g}"))

    @cached_property
    def squareness_errors(self) -> dict[str, StatedQuantity]:
        """Squareness errors that are stated on sheet 1 of the test certificate.

        The keys of the dict are the labels of the errors.
        """
        names = _names_by_label(bound_of(self.findings.posterior_of_certificate))
        stated = {}
        for label, quantity in self.parameters.items():
            if label in names and names[label].kind in _SHEET_1_KINDS:
                stated[label] = quantity
        return stated

    def angle_of_squareness(self, label: str) -> str:
        """Return a phrase that says whether the angle between two axes is below or above 90°.

        ``label`` is the label of a squareness error of these axes. Its sign is taken to be that of
        its estimate.
        """
        name = _names_by_label(bound_of(self.findings.posterior_of_certificate))[label]
        is_positive = self.squareness_errors[label].estimate > 0.0
        side = "below" if name.closes_angle == is_positive else "above"
        return self.words(f"plain.angle_{side}", first=name.axis, second=name.reference)

    @cached_property
    def directions(self) -> dict[str, StatedQuantity]:
        """Stiffness by direction at the force ``force_N``, as the test certificate states it.

        The keys of the dict are the names of the quantities, such as ``k_min`` for the least
        stiffness.
        """
        circles = {plane: self.circle_in_words(plane) for plane in self.planes}
        return stiffness_quantities(self._directional, self.words, circles)

    @cached_property
    def _directional(self) -> DirectionalStiffness:
        """Stiffness by direction, in all tested planes, at the force of the test certificate."""
        return stiffness(
            self.findings.posterior_of_certificate, [self.force_N], prob=self.findings.prob
        )

    @cached_property
    def path(self) -> dict[str, StatedQuantity]:
        """Circular deviations G, F_max and F_min of the tool path in every plane.

        The deviations are measured from the least-squares circle at the force ``force_N`` [N]. As
        effects with which they are confounded, they state the effects that readings cannot separate
        from the undetermined geometric errors (`_partners_of_geometry`). The keys of the dict are
        the symbols of the deviations, such as ``G``; they also name the plane if several planes
        were tested.
        """
        return self._path_quantities(self.force_N, ("G", "F_max", "F_min"))

    @cached_property
    def path_on_second_sheet(self) -> dict[str, StatedQuantity]:
        """Circular deviation at no load, and radial deviations from the nominal circle.

        The radial deviations from the nominal circle are computed at the force ``force_N`` [N]. The
        keys of the dict are the symbols of the deviations.
        """
        nominal = self._path_quantities(self.force_N, ("F_max_nominal", "F_min_nominal"))
        return self.unloaded_path | nominal

    @cached_property
    def unloaded_path(self) -> dict[str, StatedQuantity]:
        """Circular deviation G of the tool path (ISO 230-4) at no load, in µm, for each plane.

        Only geometric errors cause this deviation. If one plane was tested, the dict has the single
        key ``G_no_load``. If several planes were tested, each key also names the plane, as
        ``G_no_load_YZ`` does.
        """
        return self._path_quantities(0.0, ("G",))

    def _path_quantities(self, force_N: float, names: Sequence[str]) -> dict[str, StatedQuantity]:
        """Return circular-test quantities of the machine's path at the force ``force_N`` [N].

        ``names`` are the names of the quantities, such as ``G``. The result is a dict. Each key is
        a name, followed by ``_no_load`` if the force is 0 N, and by the plane if several planes
        were tested: ``G``, ``G_YZ`` or ``G_no_load_YZ``. Each value contains, among other things,
        the symbol that the certificate prints for the quantity. If the force is 0 N, this symbol
        ends in _0.
        """
        prob = self.findings.prob
        table = predict_circularity(self.findings.posterior_of_certificate, [force_N], prob=prob)
        has_several_planes = table["plane"].nunique() > 1
        confounding_effects = self._partners_of_geometry()
        suffix = "_no_load" if force_N == 0.0 else ""
        # Circular deviations without load and under load have different symbols, so that every
        # symbol on the test certificate has only one value.
        mark = "_0" if force_N == 0.0 else ""
        stated = {}
        for row in table[table["quantity"].isin(names)].to_dict(orient="records"):
            symbol = f"{row['quantity']}{suffix}"
            where = ""
            if has_several_planes:
                where = self.words("quantities.plane", plane=row["plane"])
                symbol = f"{symbol}_{row['plane']}"
            where += self.circle_in_words(row["plane"])
            stated[symbol] = StatedQuantity(
                words=self.words(f"quantities.{row['quantity']}{suffix}", plane=where),
                symbol=f"{row['quantity']}{mark}",
                estimate=row["mean"],
                sd=row["sd"],
                interval=(row["ci_low"], row["ci_high"]),
                unit="um",
                confounding_effects=confounding_effects,
                note=self._measured_words(row["plane"], row["quantity"], force_N),
            )
        return stated

    def circle_in_words(self, plane: str) -> str:
        """Return a phrase that says of which circle the quantities of a plane are.

        Circular deviations, and stiffnesses by direction, are those of the first circle in
        ``plane``. The phrase begins with a comma. It is empty if all tests in the plane have the
        same circle.
        """
        return circle_phrase(self._campaign, plane, self.words)

    @property
    def _campaign(self) -> Campaign:
        """Campaign whose quantities the sheets state."""
        return bound_of(self.findings.posterior).campaign

    @cached_property
    def _measured(self) -> pd.DataFrame:
        """Table of circular-test quantities computed from the readings alone, one row per test."""
        return measure_circularity(self.findings.posterior)[0]

    def _measured_words(self, plane: str, quantity: str, force_N: float) -> str:
        """Return a remark that states a circularity quantity computed from the readings of a test.

        ``quantity`` is the name of the quantity, such as the circular deviation. The remark uses
        the test of the circle whose quantities are stated in ``plane`` (`circle_in_words`), and of
        these the test whose force is nearest to ``force_N`` [N]. If this test is an arc, the remark
        says so, because the quantity is that of the whole circle. The remark is an empty string if
        ``force_N`` is zero.
        """
        if force_N == 0.0:
            return ""
        rows = self._measured.loc[tests_of_stated_circle(self._campaign, plane)]
        nearest = rows.iloc[int((rows["force_N"] - force_N).abs().to_numpy().argmin())]
        key = "remarks.measured"
        if nearest["arc_deg"] < FULL_CIRCLE_DEG:
            key = "remarks.measured_on_arc"
        return self.words(
            key,
            force=self.words.number(f"{nearest['force_N']:.4g}"),
            arc=self.words.number(f"{nearest['arc_deg']:.0f}"),
            value=self.words.number(f"{nearest[quantity]:.1f}".replace("-", "−")),
        )

    def _partners_of_geometry(self) -> tuple[str, ...]:
        """Return names of effects that readings cannot separate from undetermined geometric errors.

        A geometric error is undetermined if the readings hardly determine it.
        """
        partners: dict[str, None] = {}
        for name, quantity in self.parameters.items():
            if name.startswith("E_") and quantity.is_undetermined:
                partners |= dict.fromkeys(quantity.inseparable_partners)
        # Leave out the error of the bar's length, because it changes the size of the circle, but
        # not the circular deviation.
        partners.pop(BarLength.__name__, None)
        return tuple(partners)


def _direction_of_change(change: ChangeWithForce) -> Literal["increases", "decreases", "no_change"]:
    """Return whether a compliance increases or decreases with force, as a remark states it.

    The result is "no_change" if an increase and a decrease both have probabilities below 95 %.
    """
    if change.probability_of_increase >= SURE:
        return "increases"
    if change.probability_of_decrease >= SURE:
        return "decreases"
    return "no_change"


def _names_by_label(bound: BoundModel) -> dict[str, Any]:
    """Return a dict with the names of a model's compliances and geometric errors.

    The keys are labels such as ``C_XXX``. Each value is an object that represents the name; its
    attributes are the parts of the name, such as the axis. ``bound`` is a model applied to a
    campaign.
    """
    names: list[Any] = [*bound.compliances, *geometric_errors_of(bound.campaign)]
    return {name.label: name for name in names}
