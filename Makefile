# Two commands need nothing but python3: `make run` and `make test`. `make help` lists the rest.
PYTHON  ?= python3
VENV    ?= .venv
PY      := $(VENV)/bin/python
BIN     := $(VENV)/bin
PORT    ?=
ARGS    ?=
MINUTES ?= 2
SEED    ?= 1
ROOM    ?= drive
SAMPLE  ?= 120
TIER    ?= test
# Half of the tests of processes wait, so that four of them keep two cores busy.
WORKERS ?= $(shell expr 2 '*' $$(getconf _NPROCESSORS_ONLN))
# The tests start hundreds of Python processes, which need not compile yahboomd each time.
PYTEST := PYTHONDONTWRITEBYTECODE= $(PY) -m pytest
PARALLEL = -n $(WORKERS) --dist loadgroup
# Suites in other languages have a short form, with SHORT=1.
TIERS = $(if $(SHORT),-m "not nightly")
# Suites with targets of their own: they need programs of other languages.
EXTRAS := extras/fleet
OWN_TARGETS := interop generators clients browser firmware system
# Whole simulated robots, which `make quick` leaves out.
WHOLE_ROBOTS := faults whole benchmarks tools/calibrate tools/setup tools/tune moves/test_mover.py
REST := $(if $(findstring tests/,$(ARGS)),,$(OWN_TARGETS:%=--ignore=tests/%))

.DEFAULT_GOAL := help

help: ## this list
	@awk -F':.*## ' '/^##@ /{printf "\n%s\n", substr($$0, 5)} \
	  /^[a-z-]+:.*## /{printf "  make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
.PHONY: help

# Installed again after each commit or pull: its version is that of the source.
$(VENV)/.run: pyproject.toml make/bootstrap.py $(wildcard .git/logs/HEAD)
	@$(PYTHON) make/bootstrap.py $(VENV) monitor,web
	@touch $@

$(VENV)/.dev: pyproject.toml $(wildcard extras/*/pyproject.toml) make/bootstrap.py
	@$(PYTHON) make/bootstrap.py $(VENV) dev $(EXTRAS)
	@touch $@ $(VENV)/.run

##@ Use it
.PHONY: run
run: $(VENV)/.run ## start daemon, page and moves: on a simulated board, or on a real one with PORT=/dev/... (ARGS=--listen: for phones)
	@exec $(PY) make/make_run.py $(if $(PORT),--port $(PORT)) $(ARGS)

##@ Check a change
.PHONY: quick test test-all lowest fixed lint types imports schemas schemas-check
quick: $(VENV)/.dev ## a minute: lint, types, imports, and the tests that start no process and drive no robot
	@$(MAKE) --no-print-directory -j lint types imports
	$(PYTEST) -q $(PARALLEL) --hypothesis-profile=few -m "not realtime and not nightly" $(WHOLE_ROBOTS:%=--ignore=tests/%) $(REST) $(ARGS)

test: fixed ## five minutes: every claim of the daemon once, with one real process for each promise (ARGS='tests/drive -x': these only)
	$(PYTEST) $(PARALLEL) -m "not nightly" $(REST) $(ARGS)

test-all: fixed ## hours: also every case of each fault, the other languages, ROS 2, the browser, the firmwares, the installed service
	$(PYTEST) $(PARALLEL) --hypothesis-profile=many $(REST)
	@$(MAKE) --no-print-directory fleet interop clients generators browser firmware site system-test fleet-rollout

lowest: $(VENV)/.dev ## `make test` with the lowest versions that pyproject.toml allows, in build/lowest
	@mkdir -p build && $(PY) make/lowest.py > build/lowest.txt
	@PIP_CONSTRAINT=build/lowest.txt $(PYTHON) make/bootstrap.py build/lowest dev $(EXTRAS)
	$(subst $(PY),build/lowest/bin/python,$(PYTEST)) $(PARALLEL) -m "not nightly" $(REST) $(ARGS)

fixed: $(VENV)/.dev
	@$(MAKE) --no-print-directory -j lint types imports schemas-check tests/__pycache__

# In a new clone each worker would compile every test for itself.
tests/__pycache__: | $(VENV)/.dev
	@$(PYTEST) -q --collect-only -m "not nightly" $(REST) > /dev/null || true

lint: $(VENV)/.dev ## style, format, and code without a caller
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/vulture

types: $(VENV)/.dev ## mypy, strict; the client as on Python 3.10
	$(BIN)/mypy
	$(BIN)/mypy --python-version 3.10 -p yahboomd.client

imports: $(VENV)/.dev ## which room may import which
	$(BIN)/lint-imports
	@for extra in $(EXTRAS); do (cd $$extra && $(abspath $(BIN))/lint-imports) || exit 1; done

schemas: $(VENV)/.dev ## write schemas/, generated pages of docs/, man pages and completions
	$(PY) -m make.schema_files.generate schemas
	$(PY) -m make.schema_files.reference_pages events > docs/events.md
	$(PY) -m make.schema_files.reference_pages status > docs/status.md
	$(PY) -m yahboomd config reference > docs/configuration.md
	$(PY) -m yahboomd config reference --toml > config.toml
	$(PY) -m yahboomd.cli.shell.shared_files share
	$(PY) -m yahboomd.cli.shell.shared_files extras/fleet/share fleet

schemas-check: $(VENV)/.dev
	$(PY) -m make.schema_files.generate --check schemas

##@ Suites that need other languages, or more time (.ci/run runs their short forms)
.PHONY: fleet interop interop-figures ros-programs generators clients browser firmware firmware-long metrics fuzz mutants planted-faults soak faults alarms
fleet: $(VENV)/.dev ## the package yahboomd-fleet: its access rules on real routers, its stop, its page (SHORT=1: in a minute)
	$(PYTEST) $(PARALLEL) $(TIERS) extras/fleet/tests $(ARGS)

# Its peers keep the cores busier than what waits elsewhere.
interop: WORKERS = $(shell getconf _NPROCESSORS_ONLN)
interop: $(VENV)/.dev ## build the real ROS 2 peers once (in a cache outside the tree), drive through them (SHORT=1: in a minute and a half)
	@tests/interop/build.sh || echo "interop: what was not built is named above; its tests are skipped"
	$(PYTEST) $(PARALLEL) $(TIERS) tests/interop $(ARGS)

interop-figures: $(VENV)/.dev ## the same at length: latencies, losses, late joiners, 33 restarts, discovery, 32 killed nodes (half an hour)
	YAHBOOMD_INTEROP=1 $(PYTEST) tests/interop/figures.py tests/interop/test_two_machines.py tests/interop/test_deaf_nodes.py $(ARGS)

ros-programs: $(VENV)/.dev ## in a sourced ROS 2: robot_state_publisher, slam_toolbox, Nav2, ros2cli and others, as installed, against simulated robots
	$(PYTEST) -rs tests/interop/programs.py tests/interop/programs_of_two_robots.py $(ARGS)

generators: $(VENV)/.dev ## types made of schemas/ by the generators of six languages read every golden sample (SHORT=1: of two)
	$(PYTEST) $(PARALLEL) $(TIERS) tests/generators $(ARGS)

clients: $(VENV)/.dev ## build examples/clients/ in every language (once, in a cache), drive the simulated board with each (SHORT=1: those that build in moments)
	$(PYTEST) $(PARALLEL) $(TIERS) tests/clients $(ARGS)

browser: $(VENV)/.dev ## the page in a real Chromium, by touch and keys (root installs it by apt; SHORT=1: in a minute)
	@tests/browser/install.sh || echo "browser: what is not there is named above; its tests are skipped"
	$(PYTEST) $(TIERS) tests/browser $(ARGS)

$(VENV)/.firmware: pyproject.toml make/bootstrap.py $(VENV)/.dev
	@$(PYTHON) make/bootstrap.py $(VENV) firmware || echo "firmware: there is no unicorn here; the four-channel board is left out"
	@touch $@

firmware: $(VENV)/.firmware ## the control path on the vendors' own firmwares, whose files YAHBOOMD_FIRMWARE names (SHORT=1: the same)
	@$(PY) make/firmware.py $(ARGS)

firmware-long: $(VENV)/.firmware ## the simulated boards beside the firmwares, with 10^5 random commands and more (an hour or two)
	@PYTEST_TIMEOUT=7200 YAHBOOMD_FIRMWARE_LONG=1 $(PY) make/firmware.py -rP $(ARGS)

metrics: $(VENV)/.dev ## real Prometheus scrapes a real daemon: the page, alerts and the dashboard's queries (apt install prometheus)
	$(PYTEST) tests/metrics tests/prometheus tests/cli/test_metrics.py tests/cli/test_robot_poll.py $(ARGS)

$(VENV)/.fuzz: pyproject.toml make/bootstrap.py
	@$(PYTHON) make/bootstrap.py $(VENV) fuzz || \
	  { echo "yahboomd: atheris, the fuzzer, has wheels for CPython 3.11 to 3.13 on x86-64 Linux." >&2; exit 1; }
	@touch $@

fuzz: $(VENV)/.fuzz ## fuzz every reader of foreign bytes: MINUTES=8 SEED=1
	@exec $(PY) make/fuzz.py --minutes $(MINUTES) --seed $(SEED) $(ARGS)

$(VENV)/.mutants: pyproject.toml make/bootstrap.py $(VENV)/.dev
	@$(PYTHON) make/bootstrap.py $(VENV) mutants
	@touch $@

mutants: $(VENV)/.mutants ## do tests notice one-token changes? ROOM=drive SAMPLE=120 SEED=1 (pure rooms; minutes to hours)
	@exec $(PY) make/mutants.py $(ROOM) --sample $(SAMPLE) --seed $(SEED) $(ARGS)

planted-faults: $(VENV)/.dev ## which tests find faults put in by hand? TIER=test (or quick, all; hours; ARGS='NAME --only tests/link': minutes)
	@exec $(PY) make/planted_faults.py --tier $(TIER) $(ARGS)

soak: $(VENV)/.dev ## daemon and simulated boards as processes, through eleven kinds of faults: MINUTES=60 SEED=1
	@PYTHONPATH=tests/plugins $(PY) -m benchmarks.soak --minutes $(MINUTES) --seed $(SEED) $(ARGS)

faults: $(VENV)/.dev ## time from each fault to standing wheels, beside another source tree: BEFORE=tree ARGS='--times 5 --only words' (root; half an hour)
	@PYTHONPATH=tests/plugins $(PY) -m benchmarks.faults_table --before $(BEFORE) $(ARGS)

alarms: $(VENV)/.dev ## false alarms and cut times on virtual time, random driving on bad lines: MINUTES=60 SEED=1 (STICKS=1.3 FRICTION_SCALES=1,1.1: the floor)
	@PYTHONPATH=tests/plugins $(PY) -m benchmarks.false_alarms --minutes $(MINUTES) --seed $(SEED) $(ARGS)

.PHONY: power-cuts
power-cuts: $(VENV)/.dev ## power is cut 1,000 times at any write of each file that is kept (a minute; needs strace)
	YAHBOOMD_POWER_CUTS=1000 $(PYTEST) -q tests/faults/test_power_cuts.py $(ARGS)

.PHONY: every-board
every-board: $(VENV)/.dev ## every fault on the binary board of the tests too (five minutes)
	YAHBOOMD_EVERY_BOARD=1 $(PYTEST) $(PARALLEL) -q -m "not realtime" -k binary tests/faults tests/whole tests/link $(ARGS)

.PHONY: fleet-rollout
fleet-rollout: $(VENV)/.dev ## extras/fleet/ansible on three robots with real systemd, in containers over ssh: good and bad files and versions (root; ten minutes)
	@$(PY) make/fleet_rollout.py $(ARGS)

.PHONY: wirings
wirings: $(VENV)/.dev ## `setup` on all 384 ways to connect four motors, each with a drive afterwards (ten minutes; STICKS, FRICTION_SCALES: the floor)
	YAHBOOMD_EVERY_WIRING=1 $(PYTEST) $(PARALLEL) -q tests/tools/setup/test_setup_wizard.py -k four_wheels

##@ Measure
.PHONY: bench moves footprint tuning tuning-kills estop-kills picture pictures
bench: $(VENV)/.dev ## measure exactness, latency and cost, also beside the article's bridge; write docs/benchmarks.md and docs/benchmarks/ (15 minutes; ARGS=--resume continues)
	$(PY) -m benchmarks $(ARGS)

moves: $(VENV)/.dev ## 400 random moves on simulated robots beside a plain loop: the table of docs/moves.md (three minutes; ARGS='--moves 64'; STICKS, FRICTION_SCALES: the floor)
	@PYTHONPATH=tests/plugins $(PY) -m benchmarks.move_table $(ARGS)

footprint: $(VENV)/.run ## memory, threads, CPU, start-up time and sizes of the daemon
	@$(PY) -m benchmarks.footprint $(ARGS)

tuning: $(VENV)/.dev ## `tune` on every motor profile from every bad start, the table of docs/tuning.md (five minutes; STICKS, FRICTION_SCALES: the floor)
	$(PYTEST) $(PARALLEL) -rP tests/tools/tune/all_profiles.py $(ARGS)

tuning-kills: $(VENV)/.dev ## `tune` killed at random moments, also with the supply lost within a write; then --undo (RUNS=60: ten minutes)
	RUNS=$(or $(RUNS),60) $(PYTEST) $(PARALLEL) -rP tests/tools/tune/killed_runs.py $(ARGS)

estop-kills: $(VENV)/.dev ## daemons killed right after they reported an emergency stop; what did the board hear? (RUNS=1000: half an hour)
	RUNS=$(or $(RUNS),1000) SEED=$(SEED) $(PYTEST) -n 3 -rP tests/daemon/estop/estop_killed_runs.py $(ARGS)

picture: $(VENV)/.dev ## drive the simulated robot, and draw docs/images/path.png
	$(PY) make/picture.py $(ARGS)

pictures: $(VENV)/.dev ## the page's pictures in docs/images, in Chromium; or every view and state in four sizes (ARGS=build/pictures: ten minutes)
	@PYTHONPATH=.:tests/plugins:tests/browser $(PY) make/page_pictures.py $(ARGS)

##@ Package and system
.PHONY: arm bundled deb image site release system-test plug-test
deb: ## build the Debian package for this machine's distribution, into dist/
	@$(PYTHON) packaging/build_deb.py $(ARGS)

image: $(VENV)/.dev ## build the container image of each processor, drive the simulated robot in it, archives into dist/ (root; ARGS='--processor arm64')
	@$(PY) make/image.py $(ARGS)

$(VENV)/.site: pyproject.toml make/bootstrap.py
	@$(PYTHON) make/bootstrap.py $(VENV) site
	@touch $@

site: $(VENV)/.site ## the pages as a site in build/site, every link and anchor checked (ARGS='--published FOLDER': also a version there)
	@exec $(PY) make/make_site.py $(ARGS)

$(VENV)/.release: pyproject.toml make/bootstrap.py
	@$(PYTHON) make/bootstrap.py $(VENV) release
	@touch $@

release: $(VENV)/.release ## all that a release publishes, built twice, judged and tried, into dist/ (docs/release.md; ARGS=--no-deb)
	@exec $(PY) make/release.py $(ARGS)

bundled: $(VENV)/.release ## pin what the Debian package bundles anew, with hashes: packaging/bundled.txt
	@$(VENV)/bin/uv pip compile -q --upgrade --universal --python-version 3.11 --generate-hashes --no-annotate \
	  --custom-compile-command 'make bundled' --extra monitor --extra web pyproject.toml -o packaging/bundled.txt

system-test: $(VENV)/.dev ## the installed service under a real systemd, in a container (root; SUITE=trixie, SHORT=1)
	@$(PY) make/system_test.py $(if $(SUITE),--suite $(SUITE)) $(if $(SHORT),--short --if-possible) $(ARGS)

plug-test: $(VENV)/.dev ## what plugging a board in does, on a real kernel in an emulated PC (root; five minutes)
	@$(PY) make/plug_test.py $(if $(SUITE),--suite $(SUITE)) $(ARGS)

arm: $(VENV)/.dev ## the arm64 package in an emulated computer with its own kernel and systemd (root; SUITE=trixie; a quarter of an hour)
	@$(PY) make/arm.py $(if $(SUITE),--suite $(SUITE)) $(ARGS)

##@ Tidy
.PHONY: clean
clean: ## remove the environment and every cache
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
