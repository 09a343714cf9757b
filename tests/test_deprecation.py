"""Names of version 0.2 still work, and warn."""

from __future__ import annotations

import pytest

import ldbb_bayes as lb
from ldbb_bayes.deprecation import NEW_NAMES, renamed_keyword


@pytest.mark.parametrize(("old", "new"), sorted(NEW_NAMES.items()))
def test_an_old_name_leads_to_its_new_place_and_warns(old: str, new: str) -> None:
    room_name, _, name = new.rpartition(".")
    room = getattr(lb, room_name) if room_name else lb
    with pytest.warns(FutureWarning, match=rf"lb\.{old} is now lb\.{new}\. Use the new name"):
        assert getattr(lb, old) is getattr(room, name)


def test_an_old_keyword_is_taken_for_the_new_one_and_warns(recovered: lb.Campaign) -> None:
    constant = lb.HybridModel.default(degree=0)
    posterior = lb.sample(constant, recovered, sampler="independent")
    with pytest.warns(FutureWarning, match="The argument ci_prob of summarize is now prob"):
        table = lb.summarize(posterior, ci_prob=0.5)  # type: ignore[call-arg]
    assert table.equals(lb.summarize(posterior, prob=0.5))


def test_an_old_keyword_beside_the_new_one_is_refused() -> None:
    @renamed_keyword("ci_prob", "prob")
    def summarize(prob: float) -> float:
        return prob

    with (
        pytest.warns(FutureWarning, match="is now prob"),
        pytest.raises(TypeError, match=r"prob of .*summarize must be given once, .* name ci_prob"),
    ):
        summarize(prob=0.5, ci_prob=0.9)  # type: ignore[call-arg]


def test_an_old_keyword_of_a_class_is_taken_for_the_new_one(recovered: lb.Campaign) -> None:
    with pytest.warns(FutureWarning, match="The argument keep of Evidences is now keep_tests"):
        evidences = lb.inference.Evidences(recovered, keep=["f036"])  # type: ignore[call-arg]
    assert evidences.empty_copy()._keep_tests == ["f036"]


def test_old_members_of_evidences_are_the_new_ones(recovered: lb.Campaign) -> None:
    evidences = lb.inference.Evidences(recovered, tolerance=0.1)
    with pytest.warns(FutureWarning, match="Evidences.of is now nodes"):
        nodes = evidences.of(lb.HybridModel.default(degree=0))
    with pytest.warns(FutureWarning, match="Evidences.every is now computed"):
        computed = evidences.every
    assert computed == [nodes[0].evidence]


def test_there_are_at_most_45_public_names() -> None:
    assert len(lb.__all__) <= 45
    assert not set(lb.__all__) & set(NEW_NAMES)
