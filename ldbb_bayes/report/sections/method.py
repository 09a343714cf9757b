"""Priors and assumptions; method, limitations and provenance."""

from __future__ import annotations

import numpy as np

from ldbb_bayes.inference.origin import bound_of, record_of
from ldbb_bayes.model.wording import joined, term_words
from ldbb_bayes.report.document import Bullets, Details, Paragraph, Section, Sheet, sheet
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.rounding import round_like, round_uncertainty
from ldbb_bayes.units import display_name, display_unit

__all__ = ["assumptions", "method", "sign_off"]


def assumptions(found: Findings) -> Section:
    """Every prior with its unit, and the terms."""
    model = found.result["model"]
    record = record_of(found.posterior)
    idle = f" Idle here: {', '.join(term_words(name) for name in model['idle_terms'])}." if model.get("idle_terms") else ""
    fixed = f" Fixed at zero: {', '.join(model['fixed'])}." if model.get("fixed") else ""
    return Section(
        "assumptions",
        "Priors and assumptions",
        (
            Paragraph(
                f"Preset {model['preset']}, priors {model['priors']}; terms: "
                f"{', '.join(term_words(name) for name in model['terms'])}.{idle}{fixed} {_prior_words(found)}"
            ),
            _priors(found),
            Details("The whole model as TOML (edit and fit again with --model)", (Paragraph(record["model"]["toml"]),)),
        ),
    )


def _prior_words(found: Findings) -> str:
    if found.flat:
        return "Priors are flat (least squares), that of σ half-normal."
    greek = {"sigma": "σ", "delta": "δ", "kappa": "κ", "tau": "τ"}
    hypers = joined(list(dict.fromkeys(greek.get(name.split("_")[0], name) for name in found.result["hyper"])))
    held = ", restricted to compliances that are not negative at any tested force" if found.result["model"]["truncated"] else ""
    about = "the means below" if _means(found) else "zero"
    return f"Parameters have normal priors about {about}{held}; {hypers} half-normal ones."


def _means(found: Findings) -> bool:
    """Whether a prior has a mean other than zero."""
    return any(entry.get("prior_mean") for entry in found.result["parameters"].values())


def _priors(found: Findings) -> Sheet:
    bound = bound_of(found.posterior)
    rows = []
    for parameter in bound.parameters:
        factor, unit = display_unit(parameter.unit)
        told, decimals = round_uncertainty(parameter.prior_sd * factor) if np.isfinite(parameter.prior_sd) else ("flat", 0)
        rows.append([display_name(parameter.name), round_like(parameter.prior_mean * factor, decimals), told, unit])
    for name, scale in zip(bound.hyper_prior.names, bound.hyper_prior.scale_mm, strict=True):
        rows.append([str(name), "", round_uncertainty(float(scale) * 1e3)[0], "µm (scale)"])
    if _means(found):
        heads = ["parameter", "prior mean", "prior sd", "unit"]
        return sheet("Prior means and standard deviations, truncation aside", heads, rows, text=(3,))
    rows = [[name, told, unit] for name, _, told, unit in rows]
    return sheet("Prior standard deviations, truncation aside", ["parameter", "prior sd", "unit"], rows, text=(2,))


def _integrated(found: Findings) -> str:
    own = [term_words(name) for name in found.result["model"]["terms"] if name not in ("Compliance", "GeometricErrors")]
    if not own:
        return "No nuisance is in the model; parameters and σ are sampled."
    return f"Nuisances ({joined(own)}) are Gaussian and integrated out; parameters, σ and the scales are sampled."


def method(found: Findings) -> Section:
    """In short, with digests, versions and seed."""
    return Section(
        "method",
        "Method, limitations, provenance",
        (
            Paragraph(
                "Readings are a linear function of joint compliances times force, geometric errors and nuisances (hybrid "
                f"Jacobian), with white noise. {_integrated(found)} Intervals are equal-tailed credible intervals: given model "
                "and readings, the parameter lies inside with the stated probability. The model is that of 'A Novel "
                "Elasto-Geometric Model Exploiting Loaded Circular Test on a Machine Tool' (the paper; Eq. and Table are "
                "its), with nuisances."
            ),
            Bullets(
                (
                    "ln B: logarithm of the Bayes factor, how much more probable one model makes the readings than the other; "
                    "in nats (natural logarithms), 1 to 3 positive, 3 to 5 strong, more very strong evidence.",
                    "Truncation: the condition that compliances are not negative. Discrepancy: what else differs from circle "
                    "to circle.",
                    "Form of the balls at orders 2 and 3 looks exactly like geometric errors; its size is learnt from the "
                    "orders the machine cannot make. A ball with one strong lobe at order 2 or 3 breaks this.",
                    "Compliance is quasi-static and a polynomial of force; thermal drift counts only where it was asked for.",
                    "Joints that no circle of the campaign moves are taken as rigid.",
                    "Type A and B follow the GUM; budgets hold at the mean hyper-parameters and are scaled to the posterior "
                    "variance.",
                )
            ),
            _provenance(found),
        ),
    )


def _provenance(found: Findings) -> Sheet:
    provenance, campaign, model = (found.result[key] for key in ("provenance", "campaign", "model"))
    rows = [
        ["campaign", campaign["name"]],
        ["readings, SHA-256", campaign["sha256"]],
        ["model, SHA-256", model["sha256"]],
        ["sampler and seed", f"{found.result['sampler']['kind']}, {provenance['seed']}"],
        ["fitted", f"{provenance['started']}, {provenance['platform']}"],
        ["versions", ", ".join(f"{name} {value}" for name, value in provenance["versions"].items())],
    ]
    return sheet("Provenance", ["what", "value"], rows, text=(1,))


def sign_off(_: Findings) -> Section:
    """What readings do not hold and a signature needs, to be filled in."""
    blank = (
        "machine, maker and serial number; date and place of the tests; bar and balls, certificates; force device, certificate; "
    )
    blank += "temperature, warm-up; positions of axes not moved; operator; checked and signed by, date"
    rows = [[entry, ""] for entry in blank.split("; ")]
    return Section("sign-off", "Sign-off", (sheet("To be filled in", ["what", "entry"], rows, text=(1,)),))
