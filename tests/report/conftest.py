"""The page of the recovered experiment."""

from __future__ import annotations

import pytest
from reports import fitted

import ldbb_bayes as lb
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.report.findings import find
from ldbb_bayes.report.page import Document, compose, html_page


@pytest.fixture(scope="session")
def published(recovered: lb.Campaign, compared: Comparison) -> tuple[Document, str]:
    document = compose(find(fitted(lb.HybridModel.first(1), recovered), comparison=compared))
    return document, html_page(document)
