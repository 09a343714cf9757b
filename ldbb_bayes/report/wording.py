"""Every sentence about findings: templates, and small functions that choose among them and fill them with numbers.

Nothing decides by reading a sentence: what is decided stands in the findings. Kinds of findings are looked up by their values.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ldbb_bayes.model.terms import NOISE, OWN, Term
from ldbb_bayes.result import ByClass
from ldbb_bayes.units import (
    display_name,
    display_unit,
    plus_minus,
    ranked,
    round_uncertainty,
    typeset,
)

if TYPE_CHECKING:
    import pandas as pd

    from ldbb_bayes.analysis.aliases import Cure, Degeneracy, Standing
    from ldbb_bayes.analysis.budget import Budget
    from ldbb_bayes.analysis.calibration import Validation
    from ldbb_bayes.analysis.comparison import Comparison
    from ldbb_bayes.analysis.design.design import Design
    from ldbb_bayes.analysis.identifiability import DescribedMachine, Identifiability, ParameterIdentifiability, Seen
    from ldbb_bayes.analysis.sensitivity import Assumed
    from ldbb_bayes.campaign.preview import CampaignPreview, Remark
    from ldbb_bayes.inference.posterior import Concern, Fit
    from ldbb_bayes.inference.predictive import Check
    from ldbb_bayes.model.terms import Uncertainty

DEGREES = ("constant", "linear", "quadratic")
IN_FORCE = ("constant", "linear in force", "quadratic in force")
# Ratios of expected sds that differ by less count as equal.
_ALIKE = 2e-3


def _as_dict(result: Any) -> dict[str, Any]:
    """Return a result's JSON, its sentences added."""
    record: dict[str, Any] = result.as_dict()
    return record


with_words = ByClass(_as_dict)


def joined(parts: Sequence[str], word: str = "and") -> str:
    """a, b and c."""
    return f" {word} ".join(parts) if len(parts) < 3 else f"{', '.join(parts[:-1])} {word} {parts[-1]}"


def _few(names: Sequence[str]) -> str:
    """The first names, and how many there are beyond."""
    more = len(names) - _LISTED
    return ", ".join(names[:_LISTED]) + (f" and {more} more" if more > 0 else "")


def _shown(names: Sequence[str]) -> str:
    """Parameters as the paper prints them."""
    return joined([display_name(name) for name in names])


# ---- terms and aliases

_CURES = {
    "forces": "other force levels",
    "work ball": "clocking the work ball (0/45/90°)",
    "tool ball": "clocking the tool ball (0/45/90°)",
    "both balls": "clocking both balls (0/45/90°)",
    "radius": "a second radius",
    "directions": "both directions of travel at the same forces",
    "full circles": "full circles of more readings",
}
_STANDING = {
    "friction": "Friction in the bar or lost motion in proportion to force looks exactly like {names} in these directions. Run "
    "both directions at the same forces.",
    "drift": "Tests in order of force: drift of bar or centre looks exactly like {names}. Shuffle them.",
    "curvature": "A curvature in force common to all angles (force law, mount) looks exactly like equal slopes of {names}.",
    "lobes": "{names} and the 4-lobe form of the balls are told apart by force alone.",
}


def unit_words(name: str) -> tuple[float, str]:
    """Inside value of one unit that a nuisance coefficient is read in, and its label."""
    return Term.owner(name).unit_of(name)[1:]


def nuisance_words(name: str) -> str:
    """form_cos2 → 2-lobe form (cos 2θ)."""
    return Term.owner(name).describe(name)


def term_words(term: str) -> str:
    """BallForm → ball form, SetupShift → set-up shift; a parameter's name stays."""
    spaced = re.sub(r"(?<!^)(?=[A-Z])", " ", term).lower()
    return Term.kinds[term].words if term in Term.kinds else display_name(term) if "_" in term else spaced


def source_words(term: str) -> str:
    """Return what a term of a budget is called."""
    return "prior of the parameters" if term == OWN else term_words(term)


def _amount(value: float, factor: float, label: str, name: str, plus: str = "+") -> str:
    """+6.67 µm/m of E_XX1."""
    size = abs(value) * factor
    if size < 0.01 and label.startswith("µ"):
        size, label = size * 1e3, "n" + label[1:]
    return f"{plus if value > 0 else '−'}{round_uncertainty(size, 3)[0]} {label} of {name}"


def statement(found: Degeneracy) -> str:
    """Return a degeneracy with its exchange rate: what looks like what, and how much of it."""
    sign = -1.0 if found.term else 1.0
    changes = [
        _amount(sign * found.combination[name], *display_unit(found.units[name]), display_name(name)) for name in found.parameters
    ]
    left_out = "" if found.modelled else "; the model leaves it out, and the intervals do not cover it"
    nuisances = [(name, *unit_words(name)) for name in found.nuisances]
    parts = [_amount(found.combination[name], 1.0 / one, unit, nuisance_words(name), "") for name, one, unit in nuisances]
    subject = " with ".join([*parts[:1], *([joined(parts[1:])] if parts[1:] else [])])
    if len(parts) > 4:
        subject = f"{parts[0]} in company with {len(parts) - 1} other nuisances"
    if not found.term:
        company = f" in company with {len(parts)} nuisances" if parts else ""
        return f"{joined(changes)}{company} together change no reading{left_out}."
    return f"{subject} looks exactly like {joined(changes)}{left_out}."


def cure_words(found: Degeneracy, cures: Sequence[Cure]) -> str:
    """Return what would end a degeneracy."""
    calibration = Term.kinds[found.term].calibration if found.term in Term.kinds else "a calibration of it"
    text = joined([_CURES.get(cure, calibration) for cure in cures], "or") or "a narrower prior on one of them"
    return text[0].upper() + text[1:] + "."


def degeneracy_items(found: Sequence[Degeneracy], cures: Sequence[Sequence[Cure]]) -> tuple[str, ...]:
    """Return every degeneracy with what would separate it."""
    pairs = zip(found, cures, strict=True)
    return tuple(f"{statement(own)} Cure: {cure_words(own, cure)}" for own, cure in pairs)


def alias_sentences(found: Sequence[Degeneracy]) -> Iterator[str]:
    """Return what the terms of the model are confounded with, the terms that it leaves out, and parameters that are alike."""
    alike: dict[bool, dict[str, dict[str, None]]] = {False: {}, True: {}}
    for own in found:
        if own.term:
            alike[own.modelled].setdefault(own.term, {}).update(dict.fromkeys(own.parameters))
        else:
            yield f"{_shown(own.parameters)} cannot be told apart by these readings."
    covers = {
        False: "The model leaves these out: no interval covers them",
        True: "The intervals rest on what was assumed of these",
    }
    for modelled, terms in alike.items():
        if terms:
            pairs = "; ".join(f"{term_words(term)} with {_shown([*names])}" for term, names in terms.items())
            yield f"Confounded: {pairs}. {covers[modelled]} (more: ldbb-bayes identify)."


def standing_words(found: Standing) -> str:
    """Return what holds whatever is measured."""
    return _STANDING[found.kind].format(names=_shown(found.parameters))


# ---- fit

_FEW = 3
_CONTRADICTED = -13.815510557964274  # ln 1e-6
_CONCERNS = {
    "not-converged": "Not converged: ESS ≥ {limit:g} and R-hat ≤ {rhat:g} was not reached in {value:.0f} steps. Do not use the "
    "numbers; {cure}.",
    "truncation": "The readings {verb} non-negative compliance: ln P(T | y) = {value:.1f} (expected above {limit:.1f}). A "
    "nuisance may be missing, or a sign, a force or the mount compensation be wrong.",
    "one-force": "One force level: constant compliance and geometry are told apart by their priors alone.",
    "forces": "Only {value:.0f} force levels: at degree {degree:.0f} compliance and geometry need {limit:.0f} to be told apart "
    "by the readings; here their priors do it.",
    "hyper": "Misfit: {name} = {um:.3g} µm lies far above what its prior expects ({limit_um:.3g} µm at 99.9 %). The model misses "
    "something in these readings.",
    "centre": "The circle's centre shifts along {name} in proportion to force (p = {value:.1g}): compliance that changes along "
    "the travel, or a set-up that yields. C_CXY and C_CYY rest on what is assumed of it; circles at several centres would tell.",
}


def check_words(check: Check) -> str:
    """Return what a check looks at: order 4 of f520."""
    kinds = {"noise": "white noise", "autocorrelation": "autocorrelation"}
    return f"{kinds.get(check.kind, f'order {check.order}')} of {check.test}"


def fit_verdict(fit: Fit) -> str:
    """Return in one line whether the numbers can be used, and what to look at."""
    if "not-converged" in fit.kinds:
        return "NOT CONVERGED: do not use the numbers."
    moved = f"{len(fit.sensitive)} of {len(fit.sensitivity)} numbers are sensitive to their prior"
    which = ", ".join(fit.sensitive[:_FEW]) + (", …" if len(fit.sensitive) > _FEW else "")
    doubt = "the readings speak against non-negative compliance" if "truncation" in fit.kinds else expectation(fit)
    return f"Converged; {doubt}; {moved}{f' ({which})' if which else ''}."


def expectation(fit: Fit) -> str:
    """Return whether the model expects readings like these, and else what that does to the intervals."""
    if fit.misfits:
        return f"the model does not expect readings like these ({_some_checks(fit.misfits)}){_effect(fit)}"
    if fit.unexpected:
        return f"what the model does not expect ({_some_checks(fit.unexpected)}) hardly moves an interval"
    worst, count = fit.checks[0], len(fit.checks)
    return f"the model expects readings like these ({count} checks, smallest p = {worst.p:.2g}, {check_words(worst)})"


def _some_checks(checks: Sequence[Check]) -> str:
    more = f" and {len(checks) - _FEW} more" if len(checks) > _FEW else ""
    return ", ".join(check_words(check) for check in checks[:_FEW]) + more


def _effect(fit: Fit) -> str:
    moved = [f"without {name} a parameter moves by {shift:.1f} u" for name, shift in fit.shift.items()]
    wider = f"intervals would be up to {100.0 * fit.widening:.0f} % wider"
    effects = joined([*moved, *([wider] if any(own.kind != "order" for own in fit.unexpected) else [])])
    return f": {effects}" if effects else ""


def check_notes(fit: Fit) -> Iterator[str]:
    """Return a note on what is not expected though it hardly moves an interval."""
    if quiet := [own for own in fit.unexpected if own not in fit.misfits]:
        yield f"The model does not expect {_some_checks(quiet)}{_effect(fit)}."


def concern_sentences(concerns: tuple[Concern, ...], sampler: Mapping[str, Any]) -> Iterator[str]:
    """Return a sentence or two on every concern; ``sampler`` is that part of the record."""
    cures = {"independent": "ask for more independent draws (a larger --ess)"}
    for own in concerns:
        template = _CONCERNS["one-force" if own.kind == "forces" and own.value == 1 else own.kind]
        said = template.format(
            value=own.value,
            limit=own.limit,
            name=own.name,
            um=own.value * 1e3,
            limit_um=own.limit * 1e3,
            degree=own.limit - 2,
            verb="contradict" if own.value < _CONTRADICTED else "speak against",
            rhat=sampler.get("target_rhat", 0.0),
            cure=cures.get(sampler.get("kind", ""), "allow more steps (--max-steps)"),
        )
        yield typeset(said)


def model_words(model: Mapping[str, Any]) -> str:
    """Return what was fitted, from that part of a fit's JSON."""
    idle = f" Without effect here: {joined([*map(term_words, own)])}." if (own := model.get("idle_terms")) else ""
    flat = " Least squares: the intervals cover white noise alone." if model["preset"] == "paper" else ""
    truncated = "no compliance is negative" if model["truncated"] else "compliances may be negative"
    return (
        f"Compliance {IN_FORCE[model['degree']]}, reference force {model['reference_force_N']:g} N; preset {model['preset']}, "
        f"priors {model['priors']}, {truncated}; terms: {', '.join(map(term_words, model['terms']))}.{idle}{flat}"
    )


def quality_words(quality: Mapping[str, Any]) -> str:
    """Return how well the model fits, from that part of a fit's JSON."""
    return typeset(
        f"RMSE {quality['rmse_um']:.2f} µm (Eq. 34; machine and shared nuisances); linear for exact geometry costs at most "
        f"{quality['linearisation_error_um']:.4f} µm. ln P(T | y) = {quality['log_prob_truncation']:.2f}: the log probability "
        "that no compliance is negative; far below −4 the readings contradict it."
    )


def sampler_words(sampler: Mapping[str, Any]) -> str:
    """Return whether the sampler reached its target, from that part of a fit's JSON."""
    state = "" if sampler["converged"] else "NOT CONVERGED, "
    instead = ", as weights of independent draws could not be trusted" if sampler.get("by_emcee") else ""
    return (
        f"Sampler {sampler['kind']}{instead}: {state}{sampler['draws']} draws, worth {sampler['ess_bulk_min']:.0f} independent "
        f"ones (bulk ESS; tail {sampler['ess_tail_min']:.0f}); R-hat {sampler['rhat_max']:.4f} (1 when runs agree)."
    )


def fit_head(result: Mapping[str, Any]) -> tuple[str, str]:
    """Return the verdict on a fit, and what was fitted."""
    campaign = result["campaign"]
    return (
        f"Verdict: {result['fit']['verdict']}",
        f"{campaign['name']}: {campaign['tests']} tests, {campaign['readings']} readings.",
    )


def fit_sentences(result: Mapping[str, Any]) -> tuple[str, ...]:
    """Return how well the fit went, what is to be minded, and the model."""
    notes = (f"Note: {warning}" for warning in result["fit"]["warnings"])
    return (quality_words(result["fit"]), sampler_words(result["sampler"]), *notes, model_words(result["model"]))


# ---- campaign


def assumption_words(assumed: Any) -> str:
    """Return what an import assumed, why, and the option that says otherwise."""
    where = f"; {assumed.place}" if assumed.place else ""
    return f"{assumed.what}: {assumed.value} ({assumed.because}{where}): {assumed.option}"


_REMARKS: Mapping[str, str | Callable[..., str]] = {
    "travel": "stated {stated}, but the angles run {travel}",
    "arc": "arc of {arc_deg:.0f}° only: harmonics mix",
    "gap": "gap of {gap_deg:.1f}°",
    "open trace": "start and end differ by {start_end_um:+.1f} µm more than the path does there: drift, or an open trace",
    "unit": "{what} is {value:.4g} {unit}: check the unit",
    "force law": "force {force_N:g} N, but the force law gives {law_N:.0f} N at {pressure_bar:g} bar",
    "spikes": lambda reading, angle_deg, off_um, count: (
        f"reading {reading} at {angle_deg:g}° stands {off_um:+.1f} µm off its neighbours"
        f"{'' if count == 1 else f'; {count} readings do so'}"
    ),
    "step": "readings go in steps of {step_um:.3g} µm, the campaign states a resolution of {stated_um:g} µm, below "
    "whose √12th part no noise is looked for: state the step (resolution_um in campaign.toml; for a table --resolution-um)",
    "one force level": "One force level: constant compliance and geometry are told apart by their priors alone; degree 0 "
    "only. Test a second force.",
    "two force levels": "Two force levels: constant compliance only is checked by the readings; a slope needs a third.",
    "copy": "Tests {first} and {second} hold the same readings: a file read twice?",
    "one way": lambda compliance, plane: (
        f"One direction of travel (or none stated){f' in plane {plane}' if plane else ''}: friction in the bar cannot be told "
        f"from {compliance}."
    ),
    "places of one set-up": "Several planes or centres in set-up {setup}: the tool ball's offsets are shared, as if the work "
    "ball had been moved by exactly what the axes say. If the bar was mounted anew, number the set-ups.",
    "machine": lambda topology, plane, radii_mm: (
        f"Machine {topology}, plane {plane}, R = {', '.join(f'{r:g}' for r in radii_mm)} mm"
        f"{', each with a length of its own' if len(radii_mm) > 1 else ''}."
    ),
    "frames": lambda frames_mm: (
        "Joint frames stand at "
        + "; ".join(f"{axis} ({', '.join(f'{x:g}' for x in at)})" for axis, at in frames_mm.items())
        + " mm."
    ),
    "set-ups": lambda setups: f"Set-ups {', '.join(map(str, setups))}: tool offsets of each; everything else is shared.",
    "both ways": lambda planes: f"Both directions of travel in {', '.join(planes)}: hysteresis is a term of the model.",
    "covariate": "Tests record {over}s; a drift over them is modelled only when asked for (--drift {over}).",
    "readings": "Readings are actual ball distance − R; readout resolution {resolution_um:g} µm.",
    "mount": lambda deflection_um_per_bar, compensated: (
        f"Mount (Eq. 32) {deflection_um_per_bar:g} µm/bar, "
        f"{'already compensated' if compensated else 'not compensated: the nominal deflection will be subtracted'}."
    ),
    "forces": lambda slope_N_per_bar, offset_N: (
        f"Force law F = {slope_N_per_bar:g} N/bar · P {'−' if offset_N < 0 else '+'} {abs(offset_N):g} N, "
        "where a test gives only one of the two."
    ),
    "reference force": "Reference force F0 = {force_N:g} N, the middle of the tested range.",
    "balls": lambda clocked: (
        "Balls clocked between tests: two forms."
        if clocked
        else "No ball clocked between tests: one form, the sum of both balls."
    ),
}


def remark_words(remark: Remark) -> str:
    """Return a remark of a preview in words."""
    words = _REMARKS[remark.kind]
    return words.format(**remark.values) if isinstance(words, str) else words(**remark.values)


def look_sentences(seen: CampaignPreview) -> list[str]:
    """Return a sentence on everything that looks odd, with the tests it is of."""
    odd: dict[str, list[str]] = {}
    for test in seen.tests:
        for remark in test.remarks:
            odd.setdefault(remark_words(remark), []).append(test.name)
    return [f"Look at {_few(names)}: {words}." for words, names in odd.items()]


def preview_sentences(seen: CampaignPreview) -> tuple[str, ...]:
    """Return what the campaign is, and remarks on its tests; what a fit will assume is apart."""
    unstated = any(test.direction is None and test.travel is not None for test in seen.tests)
    return (
        f"{'Plan' if seen.is_plan else 'Campaign'} {seen.name}, SHA-256 {seen.sha256}.",
        *(["Directions in brackets are not stated: the angles run so."] if unstated else []),
        *look_sentences(seen),
        *(f"Note: {remark_words(remark).rstrip('.')}." for remark in seen.remarks),
    )


@with_words.register
def _(result: CampaignPreview) -> dict[str, Any]:
    record = {"schema": 1, **result.as_dict()}
    pairs: list[tuple[dict[str, Any], Any]] = [(record, result), *zip(record["tests"], result.tests, strict=True)]
    for own, found in pairs:
        own["kinds"] = [str(remark.kind) for remark in found.remarks]
        own["remarks"] = [remark_words(remark) for remark in found.remarks]
    record["assumptions"] = [remark_words(remark) for remark in result.assumptions]
    return record


def assumed_words(own: Uncertainty) -> tuple[str, str]:
    """Return what is taken for granted of the instrument, and where a certificate says it."""
    (table, _, key), kind = own.certificate.partition("_"), Term.owner(own.name)
    where = f"[{table}] {key}" if key else f"[balls.{table}]" if table else f"none: [terms.{kind.__name__}] of a model"
    return nuisance_words(own.name.replace("form_", "form_cos")).partition(" (")[0], where


# ---- machine


def machine_sentences(found: DescribedMachine) -> tuple[str, ...]:
    """Return joints, rank, and what does not show."""
    centres = "; ".join(f"({', '.join(f'{x:g}' for x in centre)})" for centre in found.centres_mm)
    bounded = [display_name(entry.name) for entry in found.compliances if entry.not_negative]
    return (
        f"{found.topology}, plane{'s' if len(found.planes) > 1 else ''} {', '.join(found.planes)}. {'; '.join(found.joints)}.",
        "Patterns: change of the reading per unit, of a compliance per unit and N; c = cos θ, s = sin θ, lengths in mm.",
        "Rotary joints, and slides that no plane here drives, count as rigid.",
        *([f"Circles centred at {centres} mm; patterns are those at the first."] if np.any(found.centres_mm) else []),
        f"{found.rank} compliances can be told apart; condition number of their columns {found.condition_number:.6g} (mm, N, R = "
        "150 mm).",
        *([f"Never seen: {', '.join(found.null)}."] if found.null else []),
        f"Cannot be negative: {', '.join(bounded) or 'none'}.",
        *([f"Left out, as combinations of several of those above: {', '.join(found.dependent)}."] if found.dependent else []),
    )


def sum_in_words(seen: Seen) -> str:
    """C_XXX + C_XXY; weights where they are not one, in mm and mm²."""
    text = ""
    for name, weight in seen.members.items():
        size = "" if abs(weight) == 1.0 else f"{abs(weight):g} "
        sign = ("−" if weight < 0 else "") if not text else (" − " if weight < 0 else " + ")
        text += f"{sign}{size}{display_name(name)}"
    return text


# ---- identifiability


def joined_sizes(hyper_um: Mapping[str, float], equals: str) -> str:
    """Return hyper-parameters with their values, the circles' scales left out."""
    sizes = {name: f"{value:.2g}{'' if name == 'decay' else ' µm'}" for name, value in hyper_um.items()}
    return ", ".join(f"{name}{equals}{size}" for name, size in sizes.items() if not name.startswith("lambda_"))


def verdict_words(entry: ParameterIdentifiability) -> str:
    """Return the verdict with the share of the variance that every partner holds."""
    known = entry.partner_shares
    shares = {term_words(p): f"{100.0 * known[p]:.0f} %" if p in known else "left out" for p in entry.partners}
    if entry.verdict == "confounded":
        return "confounded with " + " and ".join(f"{partner} ({share})" for partner, share in shares.items())
    plain = ", ".join(f"{partner} {share}" for partner, share in shares.items())
    return f"{entry.verdict} ({plain})" if plain else str(entry.verdict)


@with_words.register
def _(result: Identifiability) -> dict[str, Any]:
    record = result.as_dict()
    record.pop("cures")
    for own, found, cure in zip(record["degeneracies"], result.degeneracies, result.cures, strict=True):
        own |= {"statement": statement(found), "cure": cure_words(found, cure)}
    return record | {"notes": [standing_words(own) for own in result.standing]}


def identifiability_sentences(result: Identifiability) -> tuple[str, ...]:
    """Return what the numbers rest on, and how much the readings narrow."""
    values = joined_sizes(result.hyper_um, " = ")
    return (
        f"At {values} ({'posterior mean' if result.measured else 'prior median; no readings'}), without truncation.",
        f"Effective number of parameters {result.effective_parameters:.1f} of {len(result.parameters)} (what the readings narrow "
        "against the priors; a confounded parameter may be narrowed and still not known).",
        "Contraction 1 − (sd / prior sd)²; a term's share is what knowing it would take from the variance.",
        *_certificate_sentences(result),
    )


def _certificate_sentences(result: Identifiability) -> Iterator[str]:
    """What certificates would be worth: u of the parameters that they narrow by a tenth."""
    certificates = dict(result.certificates)
    without = certificates.pop("none of these", {})
    for name, left in certificates.items():
        share = {own: sd / without[own] for own, sd in left.items()}
        narrowed = []
        for own in ranked(share, share.__getitem__):
            entry = result.parameters[own]
            factor, unit = display_unit(entry.unit)
            if share[own] < 0.9:
                before, after = (round_uncertainty(u * factor)[0] for u in (without[own], left[own]))
                narrowed.append(f"{display_name(own)} {before} → {after} {unit}")
        yield (
            f"A certificate ({name}) would bring u of {joined(narrowed)}."
            if narrowed
            else (f"A certificate ({name}) would narrow no parameter by a tenth.")
        )


# ---- calibration


def validation_verdict(validation: Validation) -> str:
    """Return in one line whether ranks are as those of a calibrated computation."""
    tested = f"{validation.replicates} replicates, {len(validation.names)} quantities, {100 * validation.prob:g} % band"
    tested += f", emcee for {len(validation.by_emcee)} whose weights could not be trusted" if validation.by_emcee else ""
    if validation.failures:
        count, first = len(validation.failures), validation.failures[0]
        return f"NOT CALIBRATED: {count} replicates failed, first: {first} ({tested})."
    if validation.outside:
        return f"NOT CALIBRATED: the ranks of {', '.join(validation.outside)} leave the band ({tested})."
    return f"Calibrated as far as {tested} can tell."


@with_words.register
def _(result: Validation) -> dict[str, Any]:
    return {**result.as_dict(), "verdict": validation_verdict(result)}


# ---- comparison

_STRENGTHS = ((1.0, "not worth more than a bare mention"), (3.0, "positive evidence"), (5.0, "strong evidence"))
_SURE = 0.95
_SIGNS = {
    "depends on assumptions that the readings allow": "The sign is NOT robust: it depends on what is assumed.",
    "holds but for assumptions that the readings reject": "The sign holds under every assumption that the readings allow.",
    "holds under every assumption": "The sign holds under every assumption tried.",
}


def strength_words(log_bayes_factor: float) -> str:
    """Words for a log Bayes factor of either sign (Kass and Raftery, J. Am. Stat. Assoc. 90, 773-795, 1995)."""
    return next((words for limit, words in _STRENGTHS if abs(log_bayes_factor) < limit), "very strong evidence")


def comparison_sentences(comparison: Comparison) -> tuple[str, ...]:
    """The verdict: the evidence, whether its sign is robust, and what else speaks."""
    parts = (_robustness, _left_out, _slopes, _error_sought)
    return (_evidence(comparison), *(sentence for part in parts for sentence in part(comparison)))


@with_words.register
def _(result: Comparison) -> dict[str, Any]:
    sentences = comparison_sentences(result)
    found = {name: value for name, value in result.as_dict().items() if value is not None}
    return {**found, "verdict": " ".join(sentences), "sentences": list(sentences)}


def _evidence(comparison: Comparison) -> str:
    """What the evidence says, in whose favour."""
    first, second = comparison.pair
    ratio = comparison.sensitivity_of
    value, _ = comparison.headline
    favour = " either way" if abs(value) < _STRENGTHS[0][0] else f", in favour of {second if value > 0 else first}"
    shares = joined([f"{name} {probability_words(model.posterior_probability)}" for name, model in comparison.models.items()])
    over, asked = "", "Probabilities at equal prior odds"
    if (explained := comparison.explanations) is not None:
        none = _factor(explained.alone.log_bayes_factor, explained.alone.log_bayes_factor_error)
        others = joined([name for name in explained.inclusion_probability if name != "slopes"])
        over = f" averaged over {others}, each there or not, {none} with none"
        shares = joined([f"{name} {probability_words(own)}" for name, own in explained.inclusion_probability.items()])
        asked = "Probability that each is there, all combinations alike beforehand"
        likeliest = max(explained.models, key=lambda model: model.probability)
        shares += f"; likeliest {joined(likeliest.by) or 'none'} ({probability_words(likeliest.probability)})"
    says = f"{_factor(*comparison.headline)}{over}: {strength_words(value)}{favour}"
    return f"ln B({ratio}) = {says}. {asked}: {shares}."


def _factor(value: float, error: float) -> str:
    return typeset(f"{value:+.2f} (error {max(error, 1e-3):.1g})")


_ROUGH = 0.02


def factor_words(assumed: Assumed, digits: int) -> str:
    """Return ln B under an assumption to so many digits, and its error where it is weighed roughly."""
    value, error = assumed.log_bayes_factor, assumed.log_bayes_factor_error
    return f"{value:+.{digits}f}" + (f" ± {error:.1g}" if error > _ROUGH else "")


def _robustness(comparison: Comparison) -> Iterator[str]:
    if (explained := comparison.explanations) is not None and explained.instead:
        yield f"Slopes are not needed: {joined(explained.instead)} explains the readings as well."
    yield _SIGNS[comparison.sign]
    if scales := comparison.prior_sensitivity:
        values = [scaled.log_bayes_factor for scaled in scales]
        zeros = joined([f"{crossing:.2g}" for crossing in comparison.prior_sensitivity_crossings])
        there = "With all of these there and" if explained else "With"
        yield typeset(
            f"{there} slopes expected at {scales[0].slope_scale:g} to {scales[-1].slope_scale:g} times sd(C)/(F_max − F_min) it "
            f"lies between {min(values):+.1f} and {max(values):+.1f}, {f'changing sign at {zeros}' if zeros else 'of one sign'}."
        )
    if (better := comparison.preferred_assumption()) is not None:
        yield typeset(
            f"The readings prefer '{better.assumption}' by {comparison.gain(better):.1f} nats to what the models assume: under "
            f"it ln B is {better.log_bayes_factor:+.1f}. Consider making it the model."
        )
    for allowed, meant in ((True, "which the readings do not rule out"), (False, "which the readings reject")):
        turning = [f"'{a.assumption}' ({factor_words(a, 1)})" for a in comparison.turning() if comparison.allowed(a) is allowed]
        if turning:
            yield f"It turns with {joined(turning)}, {meant}."


def _left_out(comparison: Comparison) -> Iterator[str]:
    tests = comparison.tests
    flagged = {name: test for name, test in tests.items() if test.flag}
    for name, test in flagged.items():
        yield (
            f"{name} does not belong with the others (family-wise p = {test.lofo_family_wise_p_value:.2g}, most in order "
            f"{test.lofo_worst_order}): look at it, and compare again without it, for it weighs on all of the above."
        )
    at_odds = [name for name, test in tests.items() if test.stands_out and not test.flag]
    if at_odds:
        yield f"{joined(at_odds)} disagree with one another, and nothing says which is wrong: add tests."
    if tests and not flagged and not at_odds:
        smallest = min(test.lofo_family_wise_p_value for test in tests.values())
        yield f"Every test belongs with the others (smallest family-wise p = {smallest:.2g})."


def _slopes(comparison: Comparison) -> Iterator[str]:
    subsets = comparison.slope_subsets
    if not subsets:
        return
    if (possible := 2 ** len(comparison.slopes)) > len(subsets):
        yield f"Of {possible} sets of slopes the {len(subsets)} likeliest found are weighed."
    sure = joined([name for name, own in comparison.slopes.items() if own.inclusion_probability >= _SURE]) or "none"
    none = next(subset.probability for subset in subsets if not subset.varying)
    yield (
        f"Slopes one by one: beyond probability {_SURE:g}: {sure}. No slope at all has probability {none:.2g}, the likeliest set "
        f"({joined(subsets[0].varying) or 'none'}) {subsets[0].probability:.2g}. A single slope asks for less evidence than all "
        "of them at once, which is what the models compared above differ by."
    )


def _error_sought(comparison: Comparison) -> Iterator[str]:
    if count := comparison.by_emcee:
        yield f"For {count} of the log evidences weights could not be trusted: emcee took over, and bridge sampling."
    if not comparison.within_tolerance:
        error, asked = comparison.largest_error, comparison.tolerance
        yield f"A log evidence has an error of {error:.2g} nats, more than the {asked:g} asked for (--tolerance)."


# ---- design


def place_words(row: Mapping[str, Any]) -> str:
    """Return where a test is run, from one row of a design's table or a part of it."""
    parts = (
        f"plane {row['plane']}" if row.get("plane") else "",
        str(row.get("direction") or ""),
        f"set-up {row['setup']}" if row.get("setup") else "",
        f"work ball {row['work_ball_deg']:g}°, tool ball {row['tool_ball_deg']:g}°" if "work_ball_deg" in row else "",
        f"R {row['radius_mm']:g} mm" if "radius_mm" in row else "",
    )
    return ", ".join(filter(None, parts))


def design_sentences(design: Design) -> tuple[str, ...]:
    """Return the recommendation in words, its notes last."""
    return (f"Run {_tests_to_run(design)}.", *_quality(design), *_decision(design), *design_notes(design))


def design_notes(design: Design) -> tuple[str, ...]:
    """Return what the tests do not show, what would, and what the numbers rest on."""
    values = joined_sizes(design.hyper_um, " ")
    source = f"what {design.pilot.name!r} leaves likely" if design.measured else "their prior"
    basis = (
        f"Parameters are at F0 = {design.reference_force_N:g} N. Averaged over the hyper-parameters, {source} (root mean square "
        f"{values})."
    )
    error = max(own.sd_error / own.sd for own in design.expected.values())
    if error > 0.0:
        basis += f" Their number leaves expected u uncertain by at most {100.0 * error:.1f} %."
    return (*_limits(design), *degeneracy_items(design.limits.degeneracies, design.limits.cures), basis)


@with_words.register
def _(result: Design) -> dict[str, Any]:
    return {**result.as_dict(), "notes": list(design_notes(result)), "sentences": list(design_sentences(result))}


def _tests_to_run(design: Design) -> str:
    """6 circles: 2 × 36 N and 4 × 742 N."""
    table, columns = design.table, list(design.columns)
    clocked = bool((table[columns[:2]] != 0.0).any(axis=None))
    named = [name for name in columns if (clocked if name in columns[:2] else table[name].nunique() > 1)]
    words = []
    for row in table.to_dict(orient="records"):
        place = f" ({place_words({name: row[name] for name in named})})" if named else ""
        words.append(f"{row['count']} × {row['force_N']:.4g} N{place}")
    listed = joined(words) if len(words) <= 12 else "see the table"
    return f"{table['count'].sum()}{' more' if design.augment else ''} circles: {listed}"


def _ratios(design: Design) -> dict[str, float]:
    """Expected sd of every parameter of interest over that of the baseline."""
    return {name: design.expected[name].sd / design.baseline[name].sd for name in design.parameters}


def _quality(design: Design) -> Iterator[str]:
    best = "the best shares; whole tests reach it at most" if design.certificate.is_global else "the best found nearby"
    others = joined([f"{own.name} {own.efficiency:.3f} ({len(own.tests)} circles)" for own in design.compared])
    yield f"Efficiency {design.efficiency:.3f} by criterion {design.criterion} (1: {best}). For comparison: {others}."
    if not design.certificate.holds:
        excess = design.certificate.max_sensitivity / design.certificate.bound - 1.0
        yield f"The certificate does NOT hold: a sensitivity exceeds its bound by {excess:.1e}. Better shares may exist."
    ratio = _ratios(design)
    first, last = (ranked(ratio, key, tolerance=_ALIKE)[0] for key in (lambda name: -ratio[name], ratio.__getitem__))
    wide = f" to {ratio[last]:.2f} times for {display_name(last)}" if len(ratio) > 1 else ""
    yield (
        f"Expected intervals against {design.compared[0].name}: {ratio[first]:.2f} times as wide for {display_name(first)}{wide}."
    )


def _decision(design: Design) -> Iterator[str]:
    found = design.discrimination
    if found is None or not set(found.power) & set(design.parameters):
        return
    misled = joined(["< 0.0005" if p < 5e-4 else f"{p:.2g}" for p in (found.misleading_with, found.misleading_without)])
    drawn = "slopes as the tests already run leave them" if found.augmented else f"slopes of {found.size:g} prior sd"
    yield (
        f"Constant or not: with {drawn}, |ln B| > {found.threshold:g} is expected for them with probability "
        f"{found.decisive_with:.2f}; without slopes, for constant with {found.decisive_without:.2f}. Misleading evidence as "
        f"strong: {misled}."
    )


def _limits(design: Design) -> Iterator[str]:
    limits = design.limits
    if limits.levels is not None:
        yield (
            f"With {limits.levels} different force{'s' if limits.levels > 1 else ''} the readings cannot show that compliance is "
            f"not {DEGREES[design.degree]} in force: the design trusts the model. Another level would tell."
        )
    for plane, way in limits.one_way.items():
        yield (
            f"Its circles of plane {plane} all run {way}: they cannot show the hysteresis that is counted here, and their "
            "analysis would not have it. Take more circles, or both directions of each."
        )
    if limits.drift:
        yield "Drift is taken to have nothing to do with force: run the circles in the order given; record time and temperature."
    if limits.shared:
        yield (
            f"More circles of this kind, at whatever forces, would narrow {_shown(limits.shared)} by less than a fifth: what is "
            "left is shared by all circles."
        )


# ---- budget

_REMEDIES: Mapping[str, str] = {
    NOISE: "Take more readings per circle, or more circles.",
    OWN: "The readings hardly tell it: run tests that do (design).",
}


def remedy_words(budget: Budget) -> str:
    """Return what would improve a parameter most."""
    return _REMEDIES.get(budget.heaviest, Term.kinds.get(budget.heaviest, Term).remedy)


@with_words.register
def _(result: Budget) -> dict[str, Any]:
    return {**result.as_dict(), "improve": remedy_words(result)}


# ---- population and trend

_CAVEATS = {
    "excluded": "Left out, as was asked for: {names}.",
    "before": "Left out, for no date, or one before {text}: {names}.",
    "failed": "Left out, for they could not be fitted: {names}.",
    "no-statistics": "Left out, for they have no sufficient statistics (flat priors, or a breakdown: see warnings): {names}.",
    "given-again": "Left out, for their readings are those of campaigns before them: {names}.",
    "unexpected": "Left out, for the model does not expect their readings (--include-misfits keeps them): {names}.",
    "not-converged": "Not converged, refit with more draws: {names}.",
    "not-white": "Noise that is not white, so that uncertainties may be too small: {names}.",
    "no-machines": "No campaign names its machine: all are taken as campaigns of one (machine_id in campaign.toml).",
    "without-machine": "Left out for naming no machine: {names}.",
    "machines-of-their-own": "Naming no machine, each counted as one of its own: {names}. Write machine_id into campaign.toml.",
    "extrapolated": "The reference force, {0:g} N, was not within the tested forces of every campaign: compliances are carried "
    "there along the slopes that were fitted.",
    "no-dates": "No campaign has a date: the order given is taken as that of time.",
    "two-campaigns": "With two campaigns only the assumptions tell a change from what the machine changes every time.",
    "spreads-not-trusted": "The spreads cannot be trusted: Pareto's k = {0:.2f} of their weights is above {1:.2f}. Use fewer "
    "parameters or more machines.",
    "one-instrument": "Errors of one bar, the same in all campaigns ({text}), are up to {0:.0f} % of the variance of the "
    "population's mean ({parameters}), however many machines. Where the population gives the prior of a campaign with the same "
    "bar they are counted again.",
    "few-machines": "With {0:g} machines how much they differ rests on what was assumed of it, and whether one belongs is not "
    "judged: at least {1:g} are needed.",
    "uncertain-p-values": "p-values that cannot be trusted, their weights being too uneven: {names}.",
}
_LISTED, _JOINED = 5, 3
# Three decimals show no less, and never quite 0 or 1.
_UNLIKELY = 5e-4


def caveat_words(caveat: Any) -> str:
    """Return a sentence or two on what is to be minded of a trend or a population."""
    parameters = ", ".join(map(display_name, caveat.names))
    return _CAVEATS[caveat.kind].format(*caveat.values, names=_few(caveat.names), parameters=parameters, text=caveat.text)


def probability_words(probability: float) -> str:
    """Return a probability with three decimals."""
    if probability < _UNLIKELY:
        return "< 0.001"
    return "> 0.999" if probability > 1.0 - _UNLIKELY else f"{probability:.3f}"


def trend_sentences(trend: Any) -> tuple[str, ...]:
    """Return what a trend says, the most important first; its caveats are apart."""
    sentences = [*_change_in_time(trend), *_outside(trend)]
    again = " To watch for the next one, take the campaigns since as a series of their own." if trend.changed else ""
    sentences.append(f"One lasting step of one parameter is looked for, not several and not a slow drift.{again}")
    return (*sentences, *([_one_bar("changes, not for levels")] if trend.assumptions["one_instrument"] else []))


def _one_bar(of_what: str) -> str:
    return f"Not modelled: that one bar has the same length and ball form in all campaigns. That is conservative for {of_what}."


def _change_in_time(trend: Any) -> Iterator[str]:
    whose = f" of {trend.machine}" if trend.machine else ""
    prior, threshold = trend.assumptions["probability"], trend.assumptions["threshold"]
    yield (
        f"Over {len(trend.campaigns)} campaigns{whose} {'a' if trend.changed else 'no'} change is found: its probability is "
        f"{probability_words(trend.probability)} (before the readings {prior:g}; found means above {threshold:g}, which of "
        f"a machine that stays as it is has probability {trend.false_alarm:.2g} at most)."
    )
    if not trend.changed:
        return
    own = trend.parameters[trend.most_probable]
    size = plus_minus(own.change.mean, own.change.sd, own.change.interval, own.unit)
    percent = "" if own.percent is None else f", {own.percent:+.0f} % of the level before".replace("-", "−")
    when = trend.estimates.loc[trend.estimates["parameter"] == trend.most_probable, "change_here"].iloc[own.place]
    visits = trend.campaigns[own.place - 1 : own.place + 1]
    before, after = (one.campaign if one.date is None else f"{one.date.date().isoformat()} ({one.campaign})" for one in visits)
    yield (
        f"It is most probably one of {display_name(trend.most_probable)} ({probability_words(own.probability)}), then between "
        f"{before} and {after} (both: {probability_words(when)}): {size}{percent}."
    )


def _outside(trend: Any) -> Iterator[str]:
    by_campaign = trend.estimates[trend.estimates["outside"]].groupby("campaign", sort=False)["parameter"]
    words = [f"{name} ({', '.join(map(display_name, own))})" for name, own in by_campaign]
    if words:
        more = [f"{len(words) - _JOINED} more"] if len(words) > _JOINED else []
        yield f"Outside the limits drawn from the campaigns before: {joined([*words[:_JOINED], *more])}."


def population_sentences(found: Any) -> tuple[str, ...]:
    """Return what was pooled, which machines do not belong; its caveats are apart."""
    low, high = found.forces_N
    tested = f", tested from {low:g} to {high:g} N" if low <= high else ""
    sentences = [
        f"{len(found.machine)} machines, {found.campaigns} campaigns; compliances at {found.reference_force_N:g} N{tested}.",
        *(f"{name} does not belong with the others: {_how_far(found.machine[name])}." for name in found.not_belonging),
    ]
    if found.judged and not found.not_belonging:
        sentences.append("No machine stands out from the others (Holm, 5 %).")
    return tuple(sentences)


def population_doubts(found: Any) -> tuple[str, ...]:
    """Return what is to be minded of a population, and what it does not model."""
    return (
        *map(caveat_words, found.caveats),
        "Not modelled: that compliances cannot be negative, changes of a machine from campaign to campaign, and correlations of "
        "parameters from machine to machine.",
        *([_one_bar("differences between machines, not for the population's mean")] if found.instrument else []),
    )


def _how_far(own: Any) -> str:
    """How far out a machine is, and in what."""
    worst = ranked(own.z, lambda name: abs(own.z[name]))[0]
    value = "< 0.0001" if own.p_value < 1e-4 else f"= {own.p_value:.2g}"
    return f"p {value} over all machines, most in {display_name(worst)} (z = {own.z[worst]:+.1f})"


# ---- page

_CONFLICT = 0.01
RESULTS = (
    "u: standard uncertainty (posterior standard deviation). U = 2u (k = 2, about 95 %); where the distribution is skewed, the "
    "distances to the ends of the interval. Brackets: {percent} intervals. A compliance stands for the sum of its set. "
    "Identified? In brackets what knowing a term would take from the variance; such shares overlap."
)
BUDGET = (
    "Shares of the posterior variance; all sources at work together, at the mean hyper-parameters. Type A: from the scatter of "
    "the readings; type B: from what else is known (GUM). u then: what would be left if the largest term were known exactly; – "
    "where it is noise or a prior."
)
PATH = (
    "Circular deviation G, radial deviations F_max and F_min about the least-squares circle (ISO 230-4); from the second "
    "harmonic squareness (in the sense and sign of {squareness}) and scale mismatch (gain of the first axis less that of the "
    "second), compliance included. Of the machine's own path, without balls, bar, mount and tool offsets: median and {percent} "
    "interval; 0 N is geometry alone. Where the path is hardly known G is more often too large than too small."
)
NOTES = (
    "Readings are a linear function of joint compliances times force, geometric errors and nuisances (hybrid Jacobian), with "
    "white noise; nuisances are Gaussian and integrated out. The model is that of 'A Novel Elasto-Geometric Model Exploiting "
    "Loaded Circular Test on a Machine Tool' (the paper; Eq. and Table are its), with nuisances.",
    "Intervals are equal-tailed credible intervals: the parameter lies inside with the stated probability.",
    "ln B: logarithm of the Bayes factor, how much more probable one model makes the readings than the other; in nats, 1 to 3 "
    "positive, 3 to 5 strong, more very strong evidence.",
    "Truncation: the condition that compliances are not negative. Discrepancy: what else differs from circle to circle.",
    "The size of the balls' form is learnt from the orders the machine cannot make. A ball with one strong lobe at order 2 or 3 "
    "breaks this.",
    "Compliance is quasi-static and a polynomial of force; thermal drift counts only where it was asked for.",
    "Joints that no circle of the campaign moves are taken as rigid.",
)


def interval_of(entry: Mapping[str, Any]) -> tuple[float, float]:
    """Return the credible interval in the JSON of a parameter."""
    low, high = next(value for key, value in entry.items() if key.startswith("ci"))
    return low, high


def percent_of(result: Mapping[str, Any]) -> str:
    """Return the probability of the intervals in the JSON of a fit: 95 %."""
    entry = next(iter(result["parameters"].values()))
    return f"{next(key for key in entry if key.startswith('ci'))[2:]} %"


def alert_sentences(fit: Fit, result: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what forbids or limits the use of the numbers."""
    grave = tuple(concern for concern in fit.concerns if concern.kind not in ("forces", "centre"))
    lines = list(concern_sentences(grave, result["sampler"]))
    if fit.misfits and not {"not-converged", "truncation"} & set(fit.kinds):
        lines.append(f"Misfit: {expectation(fit)}. Intervals assume that the model holds.")
    if result["model"]["preset"] == "paper":
        lines.append(
            "Least squares (preset paper): the intervals cover white noise alone. Ball form, bar length, mount, force errors and "
            "what differs between circles are not in them; real uncertainties are many times larger."
        )
    return tuple(lines)


def change_sentence(first: str, other: str, table: pd.DataFrame, ci_prob: float) -> str:
    """Return which parameters of a campaign differ from those of the first."""
    tail = 0.5 - 0.5 * ci_prob
    clear = table[(table["probability_of_increase"] > 1.0 - tail) | (table["probability_of_increase"] < tail)]
    sizes = [
        f"{display_name(str(name))} {plus_minus(row['difference'], row['sd'], (row['ci_low'], row['ci_high']), row['unit'])}"
        for name, row in clear.iterrows()
    ]
    differs = "; ".join(sizes) or "no parameter"
    return f"{other} differs from {first} (± U, k = 2) in: {differs}. {100 * ci_prob:g} % intervals, each parameter by itself."


def instrument_words(reference_force_N: float, *, same: bool) -> str:
    """Return what differences between campaigns rest on."""
    rest = (
        "The instrument was the same (bar, balls, mount, force device): its errors cancel. Truncation is left out."
        if same
        else "Instruments are taken as independent. If they were the same, most differences are known better (--same-instrument)."
    )
    return f"Differences are at {reference_force_N:g} N; offsets of the tool ball are left out. {rest}"


def difference_doubts(first: str, other: str, converged: bool, conflict: tuple[str, float] | None) -> Iterator[str]:
    """Return what forbids the use of a difference."""
    if not converged:
        yield f"Not converged: {other}. Do not use its numbers."
    if conflict is not None and conflict[1] < _CONFLICT:
        yield (
            f"Not one instrument: {first} and {other} disagree about the {nuisance_words(conflict[0])} (p = {conflict[1]:.1g}). "
            "Balls turned or changed? Do not use the differences; make the page without --same-instrument."
        )


__all__ = [
    "BUDGET",
    "DEGREES",
    "IN_FORCE",
    "NOTES",
    "PATH",
    "RESULTS",
    "with_words",
    *sorted(name for name, own in globals().items() if getattr(own, "__module__", "") == __name__ and name[0] != "_"),
]
