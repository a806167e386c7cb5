# make demo    set everything up and open the page on http://127.0.0.1:7860
# make test    set everything up and pass the checks and tests
# make check   the quick part of it: style, types, import rules
# make bench   milliseconds per frame by stage, against the naive loops: a table and bench.json
# make fuzz    an hour of damaged files and wild requests (make test gives it a minute)
# make golden  draw the golden pictures anew (look at them before you commit them)

PYTHON ?= $(shell command -v python3.11 || command -v python3)
export PYTHON
BIN := .venv/bin

.PHONY: demo test check fuzz bench golden clean
.DEFAULT_GOAL := demo

.venv/.run-ready: requirements.txt .ci/venv .ci/system-packages
	@.ci/system-packages run
	@.ci/venv requirements.txt
	@touch $@

.venv/.test-ready: requirements.txt requirements-dev.txt .ci/venv .ci/system-packages
	@.ci/system-packages test
	@.ci/venv requirements-dev.txt
	@touch $@

demo: .venv/.run-ready
	$(BIN)/python app.py

check: .venv/.test-ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports

test: check
	$(BIN)/python -m pytest

fuzz: .venv/.test-ready
	FUZZ_SECONDS=3600 $(BIN)/python -m pytest tests/fuzz

bench: .venv/.run-ready
	$(BIN)/python -m app.commands.bench

golden: .venv/.test-ready
	$(BIN)/python -m tests.golden.regenerate

clean:
	rm -rf .venv .pytest_cache .ruff_cache .hypothesis .import_linter_cache
