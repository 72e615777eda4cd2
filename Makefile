# `make demo` and `make test` are all a fresh clone needs: CPython 3.11, 3.12 or 3.13, and make.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VERSION := $(shell $(PYTHON) -c 'import sys; print("{}.{}".format(*sys.version_info))')
SUPPORTED = $(if $(filter 3.11 3.12 3.13,$(VERSION)),,$(error expected CPython 3.11, 3.12 or 3.13, found $(PYTHON) $(VERSION): make PYTHON=/path/to/python3.11))
BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
CORE := .venv-core-$(VERSION)
CORE_TESTS := tests/recorders tests/replay/diff tests/replay/sources tests/pipeline/terminal \
	tests/pipeline/learner_node/test_nodes.py::test_over_zenoh_and_from_the_file_are_one_state
SEED_TESTS := tests/simulation/test_simulation.py
EXAMPLES = $(shell grep -rl --include='*.py' '>>> ' pipeline replay recorders)

# Every process that tests start reads what the first one compiled, also where the environment asks Python to keep nothing.
export PYTHONDONTWRITEBYTECODE =

.PHONY: demo test test-all test-core test-arm64 soak coverage check examples simulate bench mutants docs lock clean

demo: .venv/runtime
	$(BIN)/reenact demo --out out/demo

# First the simulated worlds, which take all processors. Three processes of the other tests keep two processors busy: many of them wait
# for other processes.
test: check examples
	$(BIN)/python -m pytest -m "not campaign" $(SEED_TESTS)
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder -m "not campaign" --ignore $(SEED_TESTS)

test-all: check examples
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder

# With the core alone, in an environment of its own: the golden cases, the tests of the recorders and some that need no extra either.
# `make test-core PYTHON=python3.13`
test-core: $(CORE)/locked
	$(CORE)/bin/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	$(CORE)/bin/reenact golden check data/golden
	$(CORE)/bin/python -m pytest -q --doctest-modules $(EXAMPLES)
	$(CORE)/bin/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder -m "not campaign and not extra" \
		--ignore tests/recorders/rerun_scene --ignore tests/recorders/reading/test_fuzz.py $(CORE_TESTS)

# Training, alignment and golden cases on an emulated arm64, every digest against this machine's. Debian's apt is needed, root is not.
test-arm64: .venv/dev
	$(BIN)/python tests/arm64/compare.py --folder out/arm64

# Robot, controller, learner and recorder for hours, simulated (`make soak HOURS=24`) or with the clock (`make soak HOURS=1 RATE=200 REAL_TIME=1`).
HOURS ?= 24
RATE ?= 20
soak: .venv/dev
	PYTHONPATH=$(CURDIR)/tests/support $(BIN)/python tests/soak/soak.py --hours $(HOURS) --rate $(RATE) \
		$(if $(REAL_TIME),--real-time) --out out/soak

# Lines and branches that the tests run, in other processes too; the table is the last thing printed, out/coverage shows each line.
coverage: .venv/dev
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder -m "not campaign" --cov --cov-report=term --cov-report=html $(TESTS)

check: .venv/dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

# Every example in a docstring.
examples: .venv/dev
	$(BIN)/python -m pytest -q --doctest-modules --durations=0 $(EXAMPLES)

# The protocol of streams in simulated worlds, a seed each: `make simulate SEEDS=10000 FROM=2000`; one seed with some of its faults:
# `make simulate FROM=7 SEEDS=1 ONLY=3,41`.
SEEDS ?= 2000
FROM ?= 0
simulate: .venv/dev
	PYTHONPATH=tests/support $(BIN)/python -m simulation --seeds $(SEEDS) --from $(FROM) $(if $(ONLY),--only $(ONLY))

bench: .venv/dev
	@for file in tests/benchmarks/bench_*.py; do $(BIN)/python $$file || exit 1; done

# Changes one operator, number or statement at a time, and fails if no test notices; tests/mutation says of what and with which tests.
# `make mutants MODULE=ticks SAMPLE=50 SEED=3`; what survived stands in out/mutants.
mutants: .venv/dev
	nice $(BIN)/python tests/mutation/campaign.py $(MODULE) $(if $(SAMPLE),--sample $(SAMPLE)) $(if $(SEED),--seed $(SEED))

# API reference and guides, into out/docs; every warning is an error. Reads the sources, imports none, asks nobody on the network.
docs: .venv/docs
	$(BIN)/mkdocs build --strict

# The locked set first, with hashes; then the package itself, which `--require-hashes` would refuse.
.venv/runtime: requirements.lock pyproject.toml
	$(SUPPORTED)
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

$(CORE)/locked: requirements-core.lock
	$(SUPPORTED)
	$(PYTHON) -m venv --clear $(CORE)
	$(CORE)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-core.lock
	touch $@

# For maintainers: the lock files anew from pyproject.toml. Needs `uv` on the path.
lock: COMPILE = uv pip compile -q --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --no-strip-extras
lock:
	$(COMPILE) --extra sim --extra view --group build pyproject.toml -o requirements.lock
	$(COMPILE) --extra sim --extra view --group build --group dev -c requirements.lock pyproject.toml -o requirements-dev.lock
	$(COMPILE) --group build --group test -c requirements-dev.lock pyproject.toml -o requirements-core.lock
	$(COMPILE) --group docs -c requirements-dev.lock -o requirements-docs.lock
	$(COMPILE) --group build -c requirements-dev.lock pyproject.toml -o data/deploy/requirements.lock

clean:
	rm -rf .venv .venv-core-* out dist
