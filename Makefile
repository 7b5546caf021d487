# Two commands need nothing but python3: `make run` and `make test`. `make help` lists the rest.
PYTHON ?= python3
VENV   ?= .venv
PY     := $(VENV)/bin/python
BIN    := $(VENV)/bin
PORT   ?=
ARGS   ?=
MINUTES ?= 2
SEED   ?= 1

.DEFAULT_GOAL := help
.PHONY: help run test check lint types imports schemas docs clean

help: ## this list
	@awk -F':.*## ' '/^[a-z-]+:.*## /{printf "  make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

$(VENV)/.run: pyproject.toml tools/bootstrap.py
	@$(PYTHON) tools/bootstrap.py $(VENV) monitor
	@touch $@

$(VENV)/.dev: pyproject.toml tools/bootstrap.py
	@$(PYTHON) tools/bootstrap.py $(VENV) dev
	@touch $@ $(VENV)/.run

run: $(VENV)/.run ## start the daemon: on a simulated board, or on a real one with PORT=/dev/...
	@exec $(PY) tools/run.py $(if $(PORT),--port $(PORT)) $(ARGS)

test: $(VENV)/.dev check ## set up, and pass every check

check: lint types imports schemas-check ## every check in this environment
	$(PY) -m pytest $(ARGS)

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.dev
	$(BIN)/mypy

imports: $(VENV)/.dev
	$(BIN)/lint-imports

schemas: $(VENV)/.dev ## write schemas/ and docs/configuration.md anew from the models
	$(PY) -m yahboomd.messages.generate schemas
	$(PY) -m yahboomd config reference > docs/configuration.md
	$(PY) -m yahboomd config reference --toml > config.toml

.PHONY: schemas-check
schemas-check: $(VENV)/.dev
	$(PY) -m yahboomd.messages.generate --check schemas

.PHONY: interop
interop: $(VENV)/.dev ## build the real ROS 2 peers once (in a cache outside the tree), drive through them
	@tests/interop/build.sh || echo "interop: what was not built is named above; its tests are skipped"
	$(PY) -m pytest tests/interop $(ARGS)

$(VENV)/.fuzz: pyproject.toml tools/bootstrap.py
	@$(PYTHON) tools/bootstrap.py $(VENV) fuzz || \
	  { echo "yahboomd: atheris, the fuzzer, has wheels for CPython 3.11 to 3.13 on x86-64 Linux." >&2; exit 1; }
	@touch $@

.PHONY: fuzz
fuzz: $(VENV)/.fuzz ## everything that reads foreign bytes, for as long as told: MINUTES=8 SEED=1
	@exec $(PY) tools/fuzz.py --minutes $(MINUTES) --seed $(SEED) $(ARGS)

.PHONY: soak
soak: $(VENV)/.run ## daemon and simulated board through all faults: MINUTES=60 SEED=1
	@exec $(PY) -m benchmarks.soak --minutes $(MINUTES) --seed $(SEED) $(ARGS)

.PHONY: picture
picture: $(VENV)/.dev ## drive the simulated robot, and draw docs/images/path.png
	$(PY) tools/picture.py $(ARGS)

$(VENV)/.bench: $(VENV)/.dev
	@$(PYTHON) tools/bootstrap.py $(VENV) uvloop || echo "bench: there is no uvloop here; its rows are left out"
	@touch $@

.PHONY: bench bench-short
bench: $(VENV)/.bench ## measure exactness, latency, throughput, cost and fleet; write docs/benchmarks.md (30 minutes; ARGS=--resume goes on)
	$(PY) -m benchmarks $(ARGS)

bench-short: $(VENV)/.dev ## the same in a short form, only to see that it works
	$(PY) -m benchmarks --short --out build/bench-short --store build/bench-short/store $(ARGS)

.PHONY: deb system-test plug-test footprint
deb: ## build the Debian package for this machine's distribution, into dist/
	@$(PYTHON) packaging/build_deb.py $(ARGS)

system-test: $(VENV)/.dev ## the installed service under a real systemd, in a container (root; SUITE=trixie, SHORT=1)
	@$(PY) tools/system_test.py $(if $(SUITE),--suite $(SUITE)) $(if $(SHORT),--short --if-possible) $(ARGS)

plug-test: $(VENV)/.dev ## what plugging a board in does, on a real kernel in an emulated PC (root; five minutes)
	@$(PY) tools/plug_test.py $(if $(SUITE),--suite $(SUITE)) $(ARGS)

footprint: $(VENV)/.run ## memory, threads, CPU, start-up time and sizes of the daemon
	@$(PY) -m benchmarks.footprint $(ARGS)

clean: ## remove the environment and every cache
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
