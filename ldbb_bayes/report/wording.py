"""Every sentence about findings: templates, and small functions that choose among them and fill them with numbers.

Nothing decides by reading a sentence: what is decided stands in the findings. Kinds of findings are looked up by their values.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ldbb_bayes.model.terms import OWN, Term
from ldbb_bayes.result import ByClass
from ldbb_bayes.units import display_name, display_unit, plus_minus, ranked, round_uncertainty, typeset

if TYPE_CHECKING:
    import pandas as pd

    from ldbb_bayes.analysis.aliases import Cure, Degeneracy, Standing
    from ldbb_bayes.analysis.calibration import Validation
    from ldbb_bayes.analysis.comparison import Comparison
    from ldbb_bayes.analysis.design import Design
    from ldbb_bayes.analysis.identifiability import Budget, DescribedMachine, Identifiability, ParameterIdentifiability, Seen
    from ldbb_bayes.campaign.preview import CampaignPreview, Remark
    from ldbb_bayes.inference.posterior import Concern, Fit
    from ldbb_bayes.inference.predictive import Check
    from ldbb_bayes.model.terms import Uncertainty

_SENTENCES: Mapping[str, Any] = tomllib.loads((Path(__file__).parent / "templates" / "sentences.toml").read_text("utf-8"))
PAGE: Mapping[str, Any] = _SENTENCES["page"]
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


def unit_words(name: str) -> tuple[float, str]:
    """Inside value of one unit that a nuisance coefficient is read in, and its label."""
    inside, one, label = Term.owner(name).unit_of(name)
    return (1.0 / display_unit(inside)[0], display_unit(inside)[1]) if inside.endswith("/N") else (one, label)


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
    return f"{plus if value > 0 else '−'}{round_uncertainty(size, 3)[0]}{'' if label == '°' else ' '}{label} of {name}"


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
        subject = f"{parts[0]} together with {len(parts) - 1} other effects"
    if not found.term:
        company = [f"{len(parts)} other effects"] if parts else []
        return f"{joined([*changes, *company])} together change no reading{left_out}."
    return f"{subject} looks exactly like {joined(changes)}{left_out}."


def cure_words(found: Degeneracy, cures: Sequence[Cure]) -> str:
    """Return what would end a degeneracy."""
    calibration = Term.kinds[found.term].calibration if found.term in Term.kinds else "a calibration of it"
    text = joined([_SENTENCES["cures"].get(cure, calibration) for cure in cures], "or") or "a narrower prior on one of them"
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
            yield f"These readings cannot separate {_shown(own.parameters)}."
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
    return _SENTENCES["standing"][found.kind].format(names=_shown(found.parameters))


# ---- fit

_FEW = 3
_CONTRADICTED = -13.815510557964274  # ln 1e-6


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
        template = _SENTENCES["concerns"]["one-force" if own.kind == "forces" and own.value == 1 else own.kind]
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
        f"RMSE {quality['rmse_um']:.2f} µm (Eq. 34, of all that circles share); linear geometry changes a reading by at most "
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
    **_SENTENCES["remarks"],
    "spikes": lambda reading, angle_deg, off_um, count: (
        f"reading {reading} at {angle_deg:g}° stands {off_um:+.1f} µm off its neighbours"
        f"{'' if count == 1 else f'; {count} readings do so'}"
    ),
    "one way": lambda compliance, plane: (
        f"One direction of travel (or none stated){f' in plane {plane}' if plane else ''}: the readings cannot separate friction "
        f"in the bar from {compliance}."
    ),
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
    "mount": lambda deflection_um_per_bar, compensated: (
        f"Mount (Eq. 32) {deflection_um_per_bar:g} µm/bar, "
        f"{'already compensated' if compensated else 'not compensated: the nominal deflection will be subtracted'}."
    ),
    "forces": lambda slope_N_per_bar, offset_N: (
        f"Force law F = {slope_N_per_bar:g} N/bar · P {'−' if offset_N < 0 else '+'} {abs(offset_N):g} N, "
        "where a test gives only one of the two."
    ),
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
    """Return what is assumed of the instrument, and where a certificate says it."""
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
        f"{found.rank} compliances can be separated; condition number of their columns {found.condition_number:.6g} (mm, N, R = "
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

ALIKE, NONE_ALIKE = "The readings of this campaign cannot separate:", "The readings determine every combination."


def joined_sizes(hyper_um: Mapping[str, float], equals: str) -> str:
    """Return hyper-parameters with their values, the circles' scales left out."""
    sizes = {name: f"{value:.2g}{'' if name == 'decay' else ' µm'}" for name, value in hyper_um.items()}
    return ", ".join(f"{name}{equals}{size}" for name, size in sizes.items() if not name.startswith("lambda_"))


def verdict_words(entry: ParameterIdentifiability, *, shares: bool = True) -> str:
    """Return the verdict, with the share of the variance that every partner holds or with the partners' names alone."""
    known = entry.partner_shares
    if not shares and entry.verdict == "confounded":
        return f"confounded with {joined([term_words(p) + ('' if p in known else ' (left out)') for p in entry.partners])}"
    if not shares:
        return str(entry.verdict)
    parts = {term_words(p): f"{100.0 * known[p]:.0f} %" if p in known else "left out" for p in entry.partners}
    if entry.verdict == "confounded":
        return "confounded with " + " and ".join(f"{partner} ({share})" for partner, share in parts.items())
    plain = ", ".join(f"{partner} {share}" for partner, share in parts.items())
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
        f"Sign free: without the condition that no compliance is negative; at {values} "
        f"({'posterior mean' if result.measured else 'prior median; no readings'}).",
        f"Effective number of parameters {result.effective_parameters:.1f} of {len(result.parameters)} (what the readings narrow "
        "against the priors; a confounded parameter may be narrowed and still unknown).",
        "Contraction: 1 − (sd / prior sd)². Gain: information in the readings; 1 nat narrows the sd to 37 %. In brackets: the "
        "share of the variance that would go if the effect were known exactly.",
        *_certificate_sentences(result),
    )


def _certificate_sentences(result: Identifiability) -> Iterator[str]:
    """What certificates would be worth: how much narrower the parameters that they narrow by a tenth."""
    certificates = dict(result.certificates)
    without = certificates.pop("none of these", {})
    for name, left in certificates.items():
        share = {own: sd / without[own] for own, sd in left.items()}
        narrowed = [
            f"u of {display_name(own)} to {100.0 * share[own]:.0f} %"
            for own in ranked(share, share.__getitem__)
            if share[own] < 0.9
        ]
        yield (
            f"A certificate ({name}) would bring {joined(narrowed)} of what it is."
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
    return f"Calibrated, as far as {tested} can show."


@with_words.register
def _(result: Validation) -> dict[str, Any]:
    return {**result.as_dict(), "verdict": validation_verdict(result)}


# ---- comparison

_STRENGTHS = ((1.0, "not worth more than a bare mention"), (3.0, "positive evidence"), (5.0, "strong evidence"))
_SURE = 0.95


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
        over = f" averaged over {others}, each in the model or not; {none} with none of them"
        shares = joined([f"{name} {probability_words(own)}" for name, own in explained.inclusion_probability.items()])
        asked = "Probability of each, all combinations being equally probable beforehand"
        likeliest = max(explained.models, key=lambda model: model.probability)
        shares += f"; most probable: {joined(likeliest.by) or 'none of them'} ({probability_words(likeliest.probability)})"
    says = f"{_factor(*comparison.headline)}{over}: {strength_words(value)}{favour}"
    return f"ln B({ratio}) = {says}. {asked}: {shares}."


def _factor(value: float, error: float) -> str:
    return typeset(f"{value:+.2f} (error {max(error, 1e-3):.1g})")


def _robustness(comparison: Comparison) -> Iterator[str]:
    if (explained := comparison.explanations) is not None and explained.instead:
        one = "s" if len(explained.instead) == 1 else ""
        yield f"Slopes are not needed: {joined(explained.instead)} explain{one} the readings as well."
    yield _SENTENCES["signs"][comparison.sign]
    if scales := comparison.prior_sensitivity:
        values = [scaled.log_bayes_factor for scaled in scales]
        zeros = joined([f"{crossing:.2g}" for crossing in comparison.prior_sensitivity_crossings])
        there = "With all of these in the model, and" if explained else "With"
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
        turning = [
            f"'{a.assumption}' ({a.log_bayes_factor:+.1f})" for a in comparison.turning() if comparison.allowed(a) is allowed
        ]
        if turning:
            yield f"The answer changes with {joined(turning)}, {meant}."


def _left_out(comparison: Comparison) -> Iterator[str]:
    tests = comparison.tests
    flagged = {name: test for name, test in tests.items() if test.flag}
    for name, test in flagged.items():
        yield (
            f"{name} does not belong with the others (family-wise p = {test.lofo_family_wise_p_value:.2g}, most in order "
            f"{test.lofo_worst_order}): look at it, and compare again without it, because it affects all of the above."
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
        yield f"Of {possible} sets of slopes the {len(subsets)} most probable ones found are compared."
    sure = joined([name for name, own in comparison.slopes.items() if own.inclusion_probability >= _SURE]) or "none"
    none = next(subset.probability for subset in subsets if not subset.varying)
    yield (
        f"Slopes one by one, with a probability above {_SURE:g}: {sure}. No slope at all has probability {none:.2g}, the "
        f"most probable set ({joined(subsets[0].varying) or 'none'}) {subsets[0].probability:.2g}. A single slope "
        "asks for less evidence than all of them at once, which is what the models compared above differ by."
    )


def _error_sought(comparison: Comparison) -> Iterator[str]:
    if count := comparison.by_emcee:
        yield f"For {count} of the log evidences weights could not be trusted: emcee and bridge sampling took over."
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
        yield f"Not proven best: a sensitivity exceeds its bound by {excess:.1e}. Better shares may exist."
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
            f"not {DEGREES[design.degree]} in force: the design trusts the model. Another level would show it."
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


def remedy_words(budget: Budget) -> str:
    """Return what would improve a parameter most."""
    return _SENTENCES["remedies"].get(budget.heaviest, Term.kinds.get(budget.heaviest, Term).remedy)


@with_words.register
def _(result: Budget) -> dict[str, Any]:
    return {**result.as_dict(), "improve": remedy_words(result)}


# ---- population and trend

_LISTED, _JOINED = 5, 3
# Three decimals show no less, and never quite 0 or 1.
_UNLIKELY = 5e-4


def caveat_words(caveat: Any) -> str:
    """Return a sentence or two on what is to be minded of a trend or a population."""
    parameters = ", ".join(map(display_name, caveat.names))
    return _SENTENCES["caveats"][caveat.kind].format(
        *caveat.values, names=_few(caveat.names), parameters=parameters, text=caveat.text
    )


def probability_words(probability: float) -> str:
    """Return a probability with three decimals."""
    if probability < _UNLIKELY:
        return "< 0.001"
    return "> 0.999" if probability > 1.0 - _UNLIKELY else f"{probability:.3f}"


def limit_words(lower: float | None, upper: float | None, factor: float = 1.0) -> str:
    """Return limits as they are written: ≤ 60, ≥ 18, ± 20, −20 to 40."""
    low, high = ("" if own is None else f"{own * factor:.4g}".replace("-", "−") for own in (lower, upper))
    if low == f"−{high}":
        return f"± {high}"
    return f"{low} to {high}" if low and high else f"≥ {low}" if low else f"≤ {high}"


def trend_sentences(trend: Any) -> tuple[str, ...]:
    """Return what a trend says, the most important first; its caveats are apart."""
    sentences = [*_change_in_time(trend), *_outside(trend)]
    again = " To watch for the next one, take the campaigns since as a series of their own." if trend.changed else ""
    sentences.append(f"Only one lasting step of one parameter is looked for, not several and not a slow drift.{again}")
    return (*sentences, *([_one_bar("changes, not for levels")] if trend.assumptions["one_instrument"] else []))


def _one_bar(of_what: str) -> str:
    return f"Not modelled: that one bar has the same length and ball form in all campaigns. That is conservative for {of_what}."


def _change_in_time(trend: Any) -> Iterator[str]:
    whose = f" of {trend.machine}" if trend.machine else ""
    prior, threshold = trend.assumptions["probability"], trend.assumptions["threshold"]
    yield (
        f"Over {len(trend.campaigns)} campaigns{whose} {'a' if trend.changed else 'no'} change is found: its probability is "
        f"{probability_words(trend.probability)} (before the readings {prior:g}; found: above {threshold:g}, which of "
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
        sentences.append("No machine stands out from the others (at 5 %, with regard to their number).")
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


def interval_of(entry: Mapping[str, Any]) -> tuple[float, float]:
    """Return the credible interval in the JSON of a parameter."""
    low, high = next(value for key, value in entry.items() if key.startswith("ci"))
    return low, high


def percent_of(result: Mapping[str, Any]) -> str:
    """Return the probability of the intervals in the JSON of a fit: 95 %."""
    entry = next(iter(result["parameters"].values()))
    return f"{next(key for key in entry if key.startswith('ci'))[2:]} %"


def annex_words(degree: int, *, averaged: bool) -> str:
    """Return which model the numbers after the sheets are of."""
    others = "; those of sheets 1 and 2 are averaged over models" if averaged else ""
    return f"Numbers from here on are those of {DEGREES[degree]} compliance alone{others}."


def alert_sentences(fit: Fit, result: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what forbids or limits the use of the numbers."""
    grave = tuple(concern for concern in fit.concerns if concern.kind not in ("forces", "centre"))
    lines = list(concern_sentences(grave, result["sampler"]))
    if fit.misfits and not {"not-converged", "truncation"} & set(fit.kinds):
        lines.append(f"Misfit: {expectation(fit)}. Intervals assume that the model holds.")
    if result["model"]["preset"] == "paper":
        lines.append(PAGE["paper"])
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
    rest = PAGE["same_instrument" if same else "other_instrument"]
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
    "ALIKE", "DEGREES", "IN_FORCE", "NONE_ALIKE", "PAGE", "with_words",
    *sorted(name for name, own in globals().items() if getattr(own, "__module__", "") == __name__ and name[0] != "_"),
]  # fmt: skip
