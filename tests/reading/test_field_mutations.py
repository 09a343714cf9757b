"""Units, radii and angles of field files changed at random: nothing is misread in silence."""

from __future__ import annotations

from pathlib import Path

import field_mutations
import numpy as np
import pytest

N_MUTATIONS = 25


@pytest.mark.parametrize("seed", range(4))
def test_no_mutation_is_misread_in_silence(seed: int, tmp_path: Path) -> None:
    random = np.random.default_rng(seed)
    for _ in range(N_MUTATIONS):
        mutated = field_mutations.mutation(random)
        became = field_mutations.outcome(tmp_path, mutated)
        assert not became.startswith("silent"), mutated.what
