# make demo    what the package does, on the embedded campaign
# make test    the fast tests
# make studies the studies; fails when a number they state is not reproduced (half an hour; QUICK=1: minutes)
# make docs    the documentation, into docs/_build
# make release VERSION=0.2.0   sets the version, builds and tries out both distributions, commits and tags; publishes nothing
# make lint, make test-slow, make package, make clean
# Everything runs in its own .venv, which holds what was asked for and no more; it needs Python 3.11 or newer with venv.

PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check
# Without bytecode every process of a test would compile the package and the tests anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-newer test-golden lint test-slow studies docs package release clean

demo: $(VENV)/.package
	$(BIN)/ldbb-bayes demo --force

test: $(VENV)/.test
	$(BIN)/python -m pytest -n 2 --dist worksteal

# What may differ between versions of Python: not how the sources are written; processes, interruptions and results kept, too.
test-newer: $(VENV)/.test
	$(BIN)/python -m pytest -n 2 --dist worksteal --ignore tests/test_plainness.py
	$(BIN)/python -m pytest -n 2 --dist worksteal -m slow -k "not dask and not demo" \
		tests/test_results.py tests/test_parallel.py tests/cli/test_processes.py

# What a reader sees must not hang on the processor: words and goldens on other kernels of OpenBLAS.
test-golden: $(VENV)/.test
	OPENBLAS_CORETYPE=$(CORETYPE) $(BIN)/python -m pytest -n 2 -m "golden and not slow" tests/test_goldens.py

# The long goldens are of one kernel of OpenBLAS: steps of a quadrature differ between kernels by less than its stated error.
test-slow: $(VENV)/.dev
	$(BIN)/python -m pytest -m "slow and not golden" -n 2 --dist worksteal
	OPENBLAS_CORETYPE=Haswell $(BIN)/python -m pytest -m "slow and golden" -n 2 --dist worksteal tests/test_goldens.py

studies: $(VENV)/.dev
	$(BIN)/python studies --at-once 2 $(if $(QUICK),--quick --workers 1)

# In DOCS_SECONDS, where a limit is given.
docs: $(VENV)/.docs
	$(if $(DOCS_SECONDS),timeout $(DOCS_SECONDS)) $(BIN)/python -m sphinx -W --keep-going -n -q -j 2 docs docs/_build

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

package: $(VENV)/.dev
	.ci/package

release: $(VENV)/.dev
	.ci/release "$(VERSION)"

$(VENV)/.package: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python 3.11 or newer is needed. On Debian 12: apt install python3"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || \
		{ echo "Python's venv and pip are missing. On Debian 12: apt install python3-venv python3-pip"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(INSTALL) --upgrade 'pip>=25.1'
	$(INSTALL) --editable .
	@touch $@

$(VENV)/.test: $(VENV)/.package
	$(INSTALL) --group test
	@touch $@

$(VENV)/.dev: $(VENV)/.test
	$(INSTALL) --group dev
	@touch $@

$(VENV)/.docs: $(VENV)/.package
	$(INSTALL) --editable '.[docs]'
	@touch $@

clean:
	rm -rf $(VENV) docs/_build build dist .pytest_cache .hypothesis .ruff_cache .mypy_cache
