# make demo    what the package does, on the embedded campaign
# make test    the fast tests
# make studies the studies; fails when a number they state is not reproduced (half an hour; QUICK=1: minutes)
# make lint, make test-slow, make clean
# Everything runs in its own .venv; it needs Python 3.11 or newer with venv, and nothing else.

PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
STAMP = $(VENV)/.installed

.PHONY: demo test lint test-slow studies clean

demo: $(STAMP)
	$(BIN)/ldbb-bayes demo --force

test: $(STAMP)
	$(BIN)/python -m pytest -n auto --dist loadscope

test-slow: $(STAMP)
	$(BIN)/python -m pytest -m slow -n auto

studies: $(STAMP)
	$(BIN)/python studies --at-once 2 $(if $(QUICK),--quick)

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python 3.11 or newer is needed. On Debian 12: apt install python3"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || \
		{ echo "Python's venv and pip are missing. On Debian 12: apt install python3-venv python3-pip"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test,lint]'
	@touch $(STAMP)

clean:
	rm -rf $(VENV) build dist .pytest_cache .hypothesis .ruff_cache .mypy_cache
