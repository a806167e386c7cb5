# make demo    set everything up and open the page on http://127.0.0.1:7860
# make test    set everything up and pass the checks and tests
# make check   the quick part of it: style, types, import rules, the page's JavaScript
# make slow    all tests, those too that take minutes each or decide little (before a release)
# make bench   what a visitor waits for, what each step costs, and a naive loop beside it
# make fuzz    an hour of damaged files and wild requests (make slow gives it half a minute)
# make soak    half an hour of four visitors at once: memory and files
# make lock    pin every package anew, with hashes, after a change of requirements
# make audit   known faults of what is locked, where the database can be asked
# make sbom    what is installed, as CycloneDX: sbom.json
# make golden  draw the golden pictures anew (look at them before you commit them)

PYTHON ?= $(shell command -v python3.11 || command -v python3)
export PYTHON
BIN := .venv/bin
# One more than there are cores, since a browser is waited for; a file is one worker's.
WORKERS = -n $(shell echo $$(($$(nproc 2>/dev/null || echo 2) + 1))) --maxprocesses 4 --dist loadfile --no-loadscope-reorder

# Each worker would compile all of it anew: 8 s.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test check style types imports messages javascript fuzz soak slow bench golden lock audit sbom clean
.DEFAULT_GOAL := demo

.venv/.run-ready: locks/run.txt .ci/venv .ci/system-packages
	@.ci/system-packages run
	@.ci/venv run
	@touch $@

.venv/.test-ready: locks/test.txt locks/cluster.txt .ci/venv .ci/system-packages
	@.ci/system-packages test
	@.ci/venv test
	@touch $@

demo: .venv/.run-ready
	$(BIN)/python app.py

check: .venv/.test-ready
	@$(MAKE) --no-print-directory --jobs 2 types style imports messages javascript

style types imports messages javascript: .venv/.test-ready
style:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
types:
	$(BIN)/pyright
imports:
	$(BIN)/lint-imports
messages:
	$(BIN)/python .ci/messages.py --check
javascript:
	@.ci/javascript

# The checks go on beside the tests, and say what they have to say in one piece when they have ended.
test: .venv/.test-ready
	@said=$$(mktemp); \
	{ $(MAKE) --no-print-directory check >$$said 2>&1; ended=$$?; echo; cat $$said; rm $$said; exit $$ended; } & \
	check=$$!; \
	$(BIN)/python -m pytest $(WORKERS); tests=$$?; \
	wait $$check || { echo "make check has failed: what it said is above"; exit 1; }; \
	exit $$tests

fuzz: .venv/.test-ready
	FUZZ_SECONDS=3600 $(BIN)/python -m pytest tests/fuzz --timeout 1800

soak: .venv/.test-ready
	SOAK_SECONDS=1800 $(BIN)/python -m pytest tests/soak

slow: .venv/.test-ready
	CHECK_SHAPES=everywhere FUZZ_SECONDS=30 $(BIN)/python -m pytest -m "slow or not slow" $(WORKERS) \
		--timeout 1800

bench: .venv/.run-ready
	$(BIN)/python -m app.bench

golden: .venv/.test-ready
	$(BIN)/python -m tests.golden.regenerate

lock: .venv/.test-ready
	.ci/lock

audit: .venv/.test-ready
	.ci/audit

sbom: .venv/.run-ready .venv/.test-ready
	$(BIN)/cyclonedx-py requirements locks/run.txt --output-reproducible -o sbom.json

clean:
	rm -rf .venv tests/javascript/node_modules tests/javascript/three/node_modules .pytest_cache .ruff_cache .hypothesis .import_linter_cache
