# The two commands: `make demo` and `make test`. Both set up what they need in .venv.
PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check install -q -c constraints.txt

.PHONY: demo test lint types docs layers bench results release-check clean

demo: .venv/core  ## rectify the photo that the repository ships
	$(BIN)/unshutter rectify examples/demo.jpg -o examples/demo.rectified.jpg --overwrite --edges crop
	@echo "Look at examples/demo.jpg and examples/demo.rectified.jpg"

test: .venv/dev  ## all tests, on all cores
	$(BIN)/python -m pytest --numprocesses auto --maxprocesses 8 --dist worksteal

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
	$(BIN)/python benchmarks/results.py $(DATA)

release-check:  ## builds what is published, and tries it in fresh environments; publishes nothing
	.ci/release-check

.venv/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "unshutter needs Python 3.11 or newer: make PYTHON=/path/to/python3.11 ...")'
	$(PYTHON) -m venv .venv
	@touch $@

.venv/core: .venv/python pyproject.toml constraints.txt
	$(PIP) -e .
	@touch $@

# torch first and by its exact version: without it, the registry's newest build brings several GB of CUDA.
.venv/dev: .venv/core
	$(PIP) torch==2.13.0
	$(PIP) -e '.[dev]'
	@touch $@

clean:
	rm -rf .venv site dist build .pytest_cache .ruff_cache .hypothesis
