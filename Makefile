# The two commands: `make demo` and `make test`. Each sets up what it needs:
# .venv has the versions of constraints.txt, .venv-newest what pip resolves today, .venv-lowest the oldest ones allowed.
# Nothing is compiled in advance, which halves the time of an installation: Python compiles what it imports, and keeps it.
unexport PYTHONDONTWRITEBYTECODE
PYTHON ?= python3
TESTS ?= tests lab/tests
BIN := .venv/bin
INSTALL := -m pip --disable-pip-version-check install -q --no-compile
PIP := $(BIN)/python $(INSTALL) -c constraints.txt
PIP_NEWEST := .venv-newest/bin/python $(INSTALL)
PIP_LOWEST := .venv-lowest/bin/python $(INSTALL) -c .venv-lowest/libraries.txt -c .venv-lowest/tools.txt
PYTEST := -m pytest --numprocesses auto --maxprocesses 8 --dist worksteal

.PHONY: demo paper test test-newest test-lowest fuzz lint prose types docs layers bench results release-check clean

demo: .venv-newest/core  ## rectify the photo that the repository ships, with what users get from pip
	.venv-newest/bin/unshutter rectify examples/demo.jpg -o examples/demo.rectified.jpg --overwrite --edges crop
	@echo "Look at examples/demo.jpg and examples/demo.rectified.jpg"

paper: .venv/dev  ## the same photo by the network of the paper that unshutter implements
	$(BIN)/unshutter rectify examples/demo.jpg --estimator kandula2020 -o examples/demo.paper.jpg --overwrite --edges crop \
	  --preview examples/demo.paper.preview.jpg
	@echo "Look at examples/demo.paper.preview.jpg: before and after, side by side"

test: .venv/dev  ## all tests, on all cores (TESTS=tests/frames: some of them)
	$(BIN)/python $(PYTEST) $(TESTS)

test-newest: .venv-newest/dev  ## the same with the newest version of everything
	.venv-newest/bin/python $(PYTEST) $(TESTS)

test-lowest: .venv-lowest/dev  ## the same with the oldest libraries that pyproject.toml allows; these use much that is deprecated
	.venv-lowest/bin/python $(PYTEST) -W ignore::DeprecationWarning $(TESTS)

fuzz: .venv/dev  ## thousands of damaged files and requests, which takes an hour; not part of CI
	UNSHUTTER_FUZZ_CASES=5000 $(BIN)/python $(PYTEST) tests/photo/test_fuzz.py tests/test_fuzz_texts.py
	set -e; for script in tests/fuzz/*.py; do nice $(BIN)/python $$script; done

prose: .venv/dev  ## long pages, banned phrases, misspelt words
	$(BIN)/python .ci/prose.py

lint: .venv/dev
	$(BIN)/ruff check . && $(BIN)/ruff format --check .

types: .venv/dev
	$(BIN)/pyright --pythonpath $(BIN)/python

docs: .venv/dev  ## fails on a broken link
	$(BIN)/mkdocs build --strict -q

layers: .venv/dev  ## fails where a room imports one that it should not know
	$(BIN)/lint-imports --no-cache --no-logo

bench: .venv/dev
	$(BIN)/python benchmarks/bench_rectify.py
	$(BIN)/python benchmarks/bench_estimators.py

results: .venv/dev  ## measures all methods (within an hour) and writes docs/results: make results DATA=../shared/data
	$(BIN)/python lab/benchmarks/results.py $(DATA)

release-check:  ## builds what is published, and tries it in fresh environments; publishes nothing
	.ci/release-check

.venv/python .venv-newest/python .venv-lowest/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "unshutter needs Python 3.11 or newer: make PYTHON=/path/to/python3.11 ...")'
	$(PYTHON) -m venv $(@D)
	@touch $@

# torch by its exact version, also among the newest: the registry's newest build brings several GB of CUDA.
.venv/dev: .venv/python pyproject.toml lab/pyproject.toml constraints.txt
	$(PIP) torch==2.13.0
	$(PIP) -e '.[dev]' -e './lab[calibrate,train,video]'
	@touch $@

.venv-newest/core: .venv-newest/python pyproject.toml
	$(PIP_NEWEST) --upgrade -e .
	@touch $@

.venv-newest/dev: .venv-newest/core lab/pyproject.toml
	$(PIP_NEWEST) --upgrade --upgrade-strategy eager -e '.[dev]' -e './lab[calibrate,train,video]' torch==2.13.0
	@touch $@

.venv-lowest/dev: .venv-lowest/python pyproject.toml lab/pyproject.toml constraints.txt .ci/lowest.py
	$(PYTHON) .ci/lowest.py libraries > .venv-lowest/libraries.txt
	$(PYTHON) .ci/lowest.py tools > .venv-lowest/tools.txt
	$(PIP_LOWEST) torch==2.13.0
	$(PIP_LOWEST) -e '.[dev]' -e './lab[calibrate,train,video]'
	@touch $@

clean:
	rm -rf .venv .venv-newest .venv-lowest site dist build .pytest_cache .ruff_cache .hypothesis
