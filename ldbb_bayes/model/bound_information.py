"""Information of the readings about all coefficients of a bound model."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms import (
    NOISE,
    OWN,
    BasisNoise,
    Columns,
)
from ldbb_bayes.results import Array

__all__ = ["information_of", "informations_of"]


def information_of(bound: BoundModel, phi: Array) -> Information:
    """What readings tell of a bound model's coefficients at φ (h,) [mm]; what differs between tests
    is noise of its test."""
    return next(informations_of(bound, phi[None]))


def informations_of(bound: BoundModel, phi: Array) -> Iterator[Information]:
    """That of `information_of` at several φ in turn, shape (w, h) [mm]; what φ only scales is
    worked out once."""
    names, owners = list(bound.names), [OWN] * len(bound.names)
    columns = [bound.interest]
    scale = list[Columns]()
    private = [
        part.values for part in bound.nuisance_columns if isinstance(part, Columns) and part.private
    ]
    # Tests of one noise: those sampled alike on circles of one kind and of one scale.
    scale_of = dict(zip(bound.hyper_prior.names, phi.T, strict=True))
    alike = [
        (
            id(test.factor),
            scale_of[circle].tobytes() if circle else b"",
            *(values[r].tobytes() for values in private),
        )
        for r, (test, circle) in enumerate(
            zip(bound.reduced, bound.setting.circle.tolist(), strict=True)
        )
    ]
    kinds = {key: r for r, key in reversed([*enumerate(alike)])}
    noise: dict[int, list[tuple[str, Columns | BasisNoise]]] = {r: [] for r in kinds.values()}
    for kind, parts in bound.columns_of.items():
        for part in parts:
            if isinstance(part, Columns) and not part.private:
                names += part.names
                owners += [kind.__name__] * len(part.names)
                columns.append(part.values)
                scale.append(part)
                continue
            for sources in noise.values():
                sources.append((kind.__name__, part))
    every = np.concatenate(columns, axis=2)
    design = tuple(test.factor @ every[r] for r, test in enumerate(bound.reduced))
    for values in phi:
        value = dict(zip(bound.hyper_prior.names, values.tolist(), strict=True))
        scales = np.concatenate([bound.scale, *(part.sd_at(value) for part in scale)])
        blocks: dict[int, dict[str, Array]] = {}
        for r, sources in noise.items():
            factor = bound.reduced[r].factor
            blocks[r] = {NOISE: np.eye(len(factor)) * value["sigma"] ** 2}
            for label, part in sources:
                if isinstance(part, BasisNoise):
                    spread = factor * part.sd_at(value, r)
                else:
                    spread = factor @ (part.values[r] * part.sd_at(value))
                blocks[r][label] = blocks[r].get(label, 0.0) + spread @ spread.T
        every_block = tuple(blocks[kinds[key]] for key in alike)
        yield Information(
            tuple(names), tuple(owners), scales, bound.model.prior.flat, design, every_block
        )
