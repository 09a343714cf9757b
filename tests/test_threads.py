"""Python calls run with one BLAS thread and give back what was there before."""

from __future__ import annotations

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import ldbb_bayes as lb
from ldbb_bayes.jobs import one_blas_thread


def blas_threads() -> set[int]:
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_one_thread_inside_and_the_old_number_after() -> None:
    with threadpool_limits(2, user_api="blas"):
        before = blas_threads()
        assert one_blas_thread(blas_threads)() == {1}
        assert blas_threads() == before
        with pytest.raises(ZeroDivisionError):
            one_blas_thread(lambda: 1 / 0)()
        assert blas_threads() == before


NAMES = ("sample", "marginals", "log_evidence", "identify", "verdicts", "compare", "design", "belonging", "local_fits")


@pytest.mark.parametrize("name", [*NAMES, "budgets", "differences", "circularity", "contributions", "nuisances", "least_squares"])
def test_what_computes_is_so_limited(name: str) -> None:
    function = getattr(lb, name)
    assert function.__code__ is one_blas_thread(lambda: None).__code__
    assert function.__wrapped__.__name__ == name
