# `make demo` and `make test` are all a fresh clone needs: Python 3.11 and make.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
SOURCES := pipeline recorders replay tests

.PHONY: demo test test-all check examples bench docs lock clean

demo: .venv/runtime
	$(BIN)/reenact demo --out out/demo

test: check examples
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder -m "not campaign"

test-all: check examples
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

check: .venv/dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

# Every example in a docstring.
examples: .venv/dev
	$(BIN)/python -m pytest -q --doctest-modules --durations=0 $$(grep -rl --include='*.py' '>>> ' pipeline replay recorders)

bench: .venv/dev
	@for file in tests/benchmarks/bench_*.py; do $(BIN)/python $$file || exit 1; done

# API reference and guides, into out/docs; every warning is an error. Reads the sources, imports none, asks nobody on the network.
docs: .venv/docs
	$(BIN)/mkdocs build --strict

# The locked set first, with hashes; then the package itself, which `--require-hashes` would refuse.
.venv/runtime: requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11) and "reenact needs Python 3.11: make PYTHON=/path/to/python3.11")'
	$(PIP) --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear .venv
	$(PIP) install --quiet --require-hashes -r requirements.lock
	$(PIP) install --quiet --no-deps --no-build-isolation --editable .
	touch $@

.venv/dev: .venv/runtime requirements-dev.lock
	$(PIP) install --quiet --require-hashes -r requirements-dev.lock
	touch $@

.venv/docs: .venv/runtime requirements-docs.lock
	$(PIP) install --quiet --require-hashes -r requirements-docs.lock
	touch $@

# For maintainers: the lock files anew from pyproject.toml. Needs `uv` on the path.
lock:
	uv pip compile -q --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --extra sim --extra view --group build pyproject.toml -o requirements.lock
	uv pip compile -q --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --extra sim --extra view --group build --group dev -c requirements.lock pyproject.toml -o requirements-dev.lock
	uv pip compile -q --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --group docs -c requirements-dev.lock -o requirements-docs.lock

clean:
	rm -rf .venv out dist
