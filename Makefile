# The two commands: `make demo` and `make test` (before a release: `make test-all`). Each sets up what it needs:
# .venv-dev has the versions of constraints.txt, .venv-newest what pip resolves today, .venv-lowest the oldest ones allowed.
# A Python that is named has its own: `make test PYTHON=python3.13` sets up .venv-3.13. Nothing here touches .venv, the
# environment that README.md tells users to create.
# Nothing is compiled in advance, which halves the time of an installation: Python compiles what it imports, and keeps it.
unexport PYTHONDONTWRITEBYTECODE
PYTHON ?= python3
TESTS ?= tests lab/tests
VERSION := $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])')
NAMED := $(if $(filter file,$(origin PYTHON)),,-$(VERSION))
ENV := .venv$(or $(NAMED),-dev)
NEWEST := .venv-newest$(NAMED)
LOWEST := .venv-lowest$(NAMED)
APP := .venv-app$(NAMED)
BIN := $(ENV)/bin
INSTALL := -m pip --disable-pip-version-check install -q --no-compile
PIP := $(BIN)/python $(INSTALL) -c constraints.txt
PIP_NEWEST := $(NEWEST)/bin/python $(INSTALL)
PIP_LOWEST := $(LOWEST)/bin/python $(INSTALL) -c $(LOWEST)/libraries.txt -c $(LOWEST)/tools.txt
# Tests of training need torch, and skip without it. It is installed for one Python only, and by its exact version among the
# newest, too: the registry's newest build brings several GB of CUDA.
ifeq ($(VERSION),3.11)
LAB := -e './lab[calibrate,train,video]' torch==2.13.0
else
LAB := -e './lab[calibrate,video]' onnx
endif
PYTEST := -m pytest --numprocesses auto --maxprocesses 8 --dist worksteal

# said at the start, where nobody asked for some of the tests only
SAY_HOW_LONG = $(if $(filter file,$(origin TESTS)),@echo "$(1) on two free cores; TESTS=tests/frames runs some of them")

.PHONY: demo paper test test-all test-newest test-lowest fuzz lint prose types docs layers script bench benchmark results app release-check clean dev dev-newest dev-lowest

demo: $(NEWEST)/core  ## rectify the photo that the repository ships, with what users get from pip
	$(NEWEST)/bin/unshutter rectify src/unshutter/page/web/sample.jpg -o examples/demo.rectified.jpg --overwrite
	@echo "Look at src/unshutter/page/web/sample.jpg and examples/demo.rectified.jpg"

paper: $(NEWEST)/core  ## the same photo by the network of the paper that unshutter implements
	$(NEWEST)/bin/unshutter rectify examples/demo.jpg --estimator kandula2020 -o examples/demo.paper.jpg --overwrite --edges crop \
	  --preview examples/demo.paper.preview.jpg
	@echo "Look at examples/demo.paper.preview.jpg: before and after, side by side"

test: $(ENV)/dev  ## each behaviour once, on all cores (TESTS=tests/frames: some of them)
	$(call SAY_HOW_LONG,About 7 minutes)
	$(BIN)/python $(PYTEST) $(TESTS)

test-all: $(ENV)/dev  ## also whole products of cases, kills again and again, training, and the long commands of the docs
	$(call SAY_HOW_LONG,About 9 minutes)
	$(BIN)/python $(PYTEST) --all $(TESTS)

test-newest: $(NEWEST)/dev  ## `make test` with the newest version of everything
	$(call SAY_HOW_LONG,About 7 minutes)
	$(NEWEST)/bin/python $(PYTEST) $(TESTS)

test-lowest: $(LOWEST)/dev  ## `make test` with the oldest libraries that pyproject.toml allows; these use much that is deprecated
	$(LOWEST)/bin/python $(PYTEST) -W ignore::DeprecationWarning $(TESTS)

dev: $(ENV)/dev  ## what `make test` needs, and test-newest, and test-lowest
dev-newest: $(NEWEST)/dev
dev-lowest: $(LOWEST)/dev

fuzz: $(ENV)/dev  ## thousands of damaged files and requests, which takes an hour; not part of CI
	UNSHUTTER_FUZZ_CASES=5000 $(BIN)/python $(PYTEST) tests/photo/test_fuzz.py tests/test_fuzz_texts.py
	set -e; for script in tests/fuzz/*.py; do nice $(BIN)/python $$script; done

prose: $(ENV)/dev  ## long pages, banned phrases, misspelt words
	$(BIN)/python .ci/prose.py

lint: $(ENV)/dev
	$(BIN)/ruff check . && $(BIN)/ruff format --check .

types: $(ENV)/dev
	$(BIN)/pyright --pythonpath $(BIN)/python

docs: $(ENV)/dev  ## fails on a broken link
	$(BIN)/mkdocs build --strict

layers: $(ENV)/dev  ## fails where a room imports one that it should not know
	$(BIN)/lint-imports --no-cache --no-logo

script:  ## lint, format and types of the page's script; needs npm, of which nothing is shipped
	.ci/script/check

bench: $(ENV)/dev
	$(BIN)/python benchmarks/bench_rectify.py
	$(BIN)/python benchmarks/bench_estimators.py

METHODS ?= none,segment-manhattan
benchmark: $(ENV)/dev  ## measures methods on sixteen places, without other data, and writes docs/results/places.md: make benchmark METHODS=all
	$(BIN)/python lab/benchmarks/places.py --estimators $(METHODS)

results: $(ENV)/dev  ## measures all methods (within an hour) and writes docs/results: make results DATA=../shared/data
	$(BIN)/python lab/benchmarks/results.py $(DATA)

app: $(APP)/app  ## the application to double-click: dist/app/unshutter, with Python and all extras
	$(APP)/bin/pyinstaller --log-level WARN --noconfirm --distpath dist/app --workpath build/app application/unshutter.spec

release-check:  ## builds what is published, and tries it in fresh environments; publishes nothing
	.ci/release-check

$(ENV)/python $(NEWEST)/python $(LOWEST)/python $(APP)/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "unshutter needs Python 3.11 or newer: make PYTHON=/path/to/python3.11 ...")'
	$(PYTHON) -m venv $(@D)
	@touch $@

$(ENV)/dev: $(ENV)/python pyproject.toml lab/pyproject.toml constraints.txt
	$(PIP) -e '.[dev]' $(LAB)
	@touch $@

$(NEWEST)/core: $(NEWEST)/python pyproject.toml
	$(PIP_NEWEST) --upgrade -e .
	@touch $@

$(NEWEST)/dev: $(NEWEST)/core lab/pyproject.toml
	$(PIP_NEWEST) --upgrade --upgrade-strategy eager -e '.[dev]' $(LAB)
	@touch $@

$(LOWEST)/dev: $(LOWEST)/python pyproject.toml lab/pyproject.toml constraints.txt .ci/lowest.py
	$(PYTHON) .ci/lowest.py libraries > $(LOWEST)/libraries.txt
	$(PYTHON) .ci/lowest.py tools > $(LOWEST)/tools.txt
	$(PIP_LOWEST) -e '.[dev]' $(LAB)
	@touch $@

$(APP)/app: $(APP)/python pyproject.toml constraints.txt
	$(APP)/bin/python $(INSTALL) -c constraints.txt -e '.[app]'
	@touch $@

clean:
	rm -rf .venv-* site dist build .pytest_cache .ruff_cache .hypothesis
