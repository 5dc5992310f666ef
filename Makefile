# Two commands set everything up on a fresh machine: `make demo` and `make test`.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
DEMO   ?= rotorid-out/demo
# Everything that is installed has the version and the hash of uv.lock; uv itself, which reads that file, has this one.
UV     := 0.13.9
SYNC   := UV_PROJECT_ENVIRONMENT=$(VENV) $(BIN)/uv sync --quiet --inexact --extra figures

# Hundreds of tests start the program: what Python compiled once is kept.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test checks compiled quick newest study bench peers pictures docs clean

demo: $(VENV)/.installed
	$(BIN)/rotorid demo --out $(DEMO)

test: $(VENV)/.installed-dev
	$(MAKE) --jobs 2 checks compiled
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest --numprocesses auto --dist loadscope --no-loadscope-reorder

checks: $(VENV)/.installed-dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports
	$(BIN)/mypy

# A flight and two identifications: most of what is compiled, before the tests would do so on every core at once.
compiled: $(VENV)/.installed-dev $(VENV)/collected
	OPENBLAS_NUM_THREADS=1 $(BIN)/rotorid demo --quiet --force --out $(VENV)/compiled

# The tests themselves, which pytest rewrites: once in an environment, later only those that changed since.
$(VENV)/collected: $(VENV)/.installed-dev
	$(BIN)/pytest --collect-only --quiet > $@.part
	mv $@.part $@

# The tests of what changed since BASE, nearest first, in about a minute; the nearest of the others are listed.
BASE ?= HEAD
quick: $(VENV)/.installed-dev
	$(BIN)/ruff check
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest --numprocesses auto --dist loadscope $$($(BIN)/python -m tests.quick $(BASE))

# The long studies, part by part: a second run goes on where the first ended. PART chooses some by their paths.
PART ?=
study: $(VENV)/.installed-dev
	$(BIN)/python -m tests.study $(PART)

bench: $(VENV)/.installed-dev
	$(BIN)/python -m benchmarks

# The same work by other tools, as far as they are installed, kept in benchmarks/peers.json: docs/peers.md.
peers: $(VENV)/.installed-dev
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.peers
	$(BIN)/python -m benchmarks

# The pictures of the README, taken of the pages of an example in a real browser.
pictures: $(VENV)/.installed-dev
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.docs.pictures

# The documentation as a site, in build/site/html; warnings are errors, and nothing is fetched. Every block of the
# tutorials is executed before: a page that shows something else than the program prints is no site.
docs: $(VENV)/.installed-dev
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest --numprocesses auto -m "slow or not slow" tests/docs/test_tutorials.py
	$(BIN)/python docs/site/build.py build/site

$(BIN)/uv:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet uv==$(UV)

$(VENV)/.installed: $(BIN)/uv pyproject.toml uv.lock
	$(SYNC) --locked --no-dev
	touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
	$(SYNC) --locked
	touch $@

# The newest versions that the registry has, in the same environment, to see what is coming; the lock file stays.
newest: $(VENV)/.installed-dev
	$(BIN)/uv pip install --quiet --python $(BIN)/python --upgrade --resolution highest --editable '.[figures]' --group dev

clean:
	rm -rf $(VENV) rotorid-out
