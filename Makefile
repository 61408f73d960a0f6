# Set-up, tests and the demo, without root and without a sourced ROS installation.
# `make` lists the targets. A ROS 2 Jazzy installation uses colcon instead, see README.md.

VENV := .venv
OLDEST := .venv-oldest
STAMPS := $(VENV)/.stamps
SCRATCH := build/venv
BIN := $(VENV)/bin
# Arguments for pytest, as in: make test-core ARGS="-k joint -x"
ARGS ?=
JOBS ?= $(shell nproc)
# Graph tests wait more than they compute; every one has a ROS domain of its own.
# pytest ends with 5 where ARGS select nothing.
NODE_JOBS ?= 2

SHELL := /bin/sh
.SHELLFLAGS := -euc
.DELETE_ON_ERROR:
.NOTPARALLEL:
MAKEFLAGS += --no-builtin-rules

# A sourced ROS installation and an active environment would mix with the one built here.
unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV
# Without compiled modules every process compiles what it imports: seconds, for each node.
unexport PYTHONDONTWRITEBYTECODE
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH RMW_IMPLEMENTATION
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
ifdef AMENT_PREFIX_PATH
unexport LD_LIBRARY_PATH
endif
export PIP_DISABLE_PIP_VERSION_CHECK := 1

say := @printf '[setup] %s\n'
# Twice quiet: errors only.
pip := $(BIN)/python -m pip --quiet --quiet --no-input
# $(call install,environment,arguments): uv takes a fraction of the time of pip. It knows nothing of
# pip's settings (mirrors), so what it cannot install is left to pip.
install = $(1)/bin/python -m uv --quiet pip install --compile-bytecode --python $(1)/bin/python \
	$(2) 2>/dev/null || \
	$(1)/bin/python -m pip --quiet --quiet --no-input install $(2)
install_uv = $(1)/bin/python -m pip --quiet --quiet --no-input install --requirement requirements/uv.txt

# ---------------------------------------------------------------- what users call

.DEFAULT_GOAL := help

.PHONY: help
help: ## list the targets
	@echo 'gda_tracker: multi-target radar tracking for ROS 2 Jazzy'
	@echo
	@sed -n 's/^\([a-z-]*\):[^#]*## \(.*\)/  make \1\t\2/p' $(firstword $(MAKEFILE_LIST)) | expand -t 22
	@echo
	@echo '  PYTHON=python3.12  the interpreter for the environments (default: python3)'
	@echo '  ARGS="-k name -x"  arguments for pytest'

.PHONY: setup
setup: ## build the environment in .venv: ROS 2 wheels, messages, gda_tracker (about 2 minutes, once)
	@$(call locked,environment)

.PHONY: demo
demo: setup ## run the demo
	@$(BIN)/gda-tracker demo

.PHONY: test
test: lint docs test-core test-nodes test-kills-beside-oldest ## run everything: lint, docs, core, nodes, oldest numpy and scipy

.PHONY: setup-test
setup-test: ## the environment with the test tools
	@$(call locked,environment-test)

.PHONY: messages
messages: ## build tf2_msgs, radar_msgs, vision_msgs, autoware_perception_msgs into .venv too
	@$(call locked,environment-messages)

.PHONY: lint
lint: setup-test ## check style, format, types and import layers
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

.PHONY: docs
docs: setup-test ## build the documentation as a site into build/site
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo 'documentation: build/site/index.html'

.PHONY: test-core
test-core: setup-test ## test everything that needs no running nodes
	$(test_environment) $(BIN)/python -m pytest test --ignore=test/nodes -n $(JOBS) $(ARGS)

.PHONY: test-nodes
test-nodes: setup-test ## test the node graph over DDS
	$(test_environment) $(BIN)/python -m pytest test/nodes --ignore=test/nodes/test_kills.py \
		-n $(NODE_JOBS) --dist worksteal $(ARGS) || [ $$? -eq 5 ]

.PHONY: test-kills
test-kills: setup-test ## kill nodes of the graph while scans are on their way (some minutes)
	$(test_environment) $(BIN)/python -m pytest test/nodes/test_kills.py $(ARGS) || [ $$? -eq 5 ]

# The one waits most of the time, the other computes.
.PHONY: test-kills-beside-oldest
test-kills-beside-oldest: setup-test
	@$(call locked,environment-oldest)
	@$(MAKE) --no-print-directory test-kills > build/test-kills.log 2>&1 & kills=$$!; \
	trap "kill $$kills 2>/dev/null || true" EXIT; \
	status=0; \
	$(MAKE) --no-print-directory test-oldest || status=$$?; \
	wait $$kills || status=$$?; \
	cat build/test-kills.log; \
	exit $$status

# What needs ROS, bags, a browser or the installed package is left out, what takes long, and what
# runs whole commands or all parameters: no other numpy than in the tests of what they call. Of a
# parametrised test the first cases run: a call that an older library has not is in each of them.
not_on_oldest := nodes io commands tuning test_packaging.py test_documentation.py view/test_page.py \
	evaluation/test_command.py evaluation/test_association_log.py evaluation/test_calibration.py \
	tracking/test_live_parameters.py fusion/test_live_fusion_parameters.py \
	events/test_live_event_parameters.py

.PHONY: test-oldest
test-oldest: ## test the core with the oldest numpy and scipy, without ROS
	@$(call locked,environment-oldest)
	$(OLDEST)/bin/python -m pytest test $(addprefix --ignore=test/,$(not_on_oldest)) -m 'not slow' \
		--first-cases 2 -n $(JOBS) $(ARGS)

.PHONY: benchmark
benchmark: setup ## measure latency, speed and tracking, also against Stone Soup (about 15 minutes)
	@$(call locked,environment-benchmark)
	$(BIN)/python -m benchmarks.ring_latency
	$(BIN)/python -m benchmarks.evidence
	$(BIN)/python -m benchmarks.autoferry_vs_stonesoup
	$(BIN)/python -m benchmarks.offline_vs_stonesoup

.PHONY: format
format: setup-test ## format the code and fix what ruff can fix
	$(BIN)/ruff check --fix-only
	$(BIN)/ruff format

.PHONY: clean
clean: ## remove builds and caches
	rm -rf build install log dist *.egg-info .mypy_cache .pytest_cache .ruff_cache \
		.import_linter_cache .hypothesis
	find gda_tracker launch test -name __pycache__ -prune -exec rm -rf {} + 2>/dev/null || true

.PHONY: distclean
distclean: clean ## remove the environments too
	rm -rf $(VENV) $(OLDEST)

# Wrong Python types in messages fail, nodes stay on this machine, logs stay in the build folder.
test_environment := \
	ROS_PYTHON_CHECK_FIELDS=1 \
	ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST \
	ROS_LOG_DIR=$(CURDIR)/build/ros_log

# ---------------------------------------------------------------- the environment

# One set-up at a time in this tree; a second one waits and then finds nothing to do.
locked = mkdir -p build; \
	if command -v flock >/dev/null; then \
		flock build/.setup.lock $(MAKE) --no-print-directory $(1); \
	else \
		$(MAKE) --no-print-directory $(1); \
	fi

.PHONY: environment environment-test environment-benchmark environment-oldest environment-messages
environment: $(STAMPS)/package
	@:
environment-test: environment $(STAMPS)/foreign $(STAMPS)/test
	@:
environment-messages: environment $(STAMPS)/foreign
	@:
environment-benchmark: environment $(STAMPS)/benchmark
	@:
environment-oldest: $(OLDEST)/.stamps/oldest
	@:

# An environment does not survive being moved or copied: its scripts name its path.
ifneq ($(shell cat $(STAMPS)/venv 2>/dev/null),$(CURDIR))
.PHONY: $(STAMPS)/venv
endif
$(STAMPS)/venv:
	$(say) 'checking the tools of this machine'
	@requirements/check-tools.sh >/dev/null
	@python=$$(requirements/check-tools.sh) && \
		printf '[setup] creating $(VENV) with %s\n' "$$($$python --version)" && \
		$$python -m venv --clear $(VENV)
	@$(call install_uv,$(VENV))
	@rm -rf $(SCRATCH)
	@mkdir -p $(STAMPS)
	@echo '$(CURDIR)' > $@

install_requirements := requirements/ros.txt requirements/build.txt requirements/runtime.txt

# The start-up module makes .venv usable without sourcing anything, see its text.
$(STAMPS)/wheels: $(STAMPS)/venv $(install_requirements) requirements/constraints.txt \
		requirements/gda_tracker_venv.py
	$(say) 'installing ROS 2 Jazzy, numpy and scipy (about 130 packages, one minute)'
	@$(call install,$(VENV),--constraint requirements/constraints.txt \
		$(addprefix --requirement ,$(install_requirements)))
	@site=$$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))') && \
		cp requirements/gda_tracker_venv.py "$$site" && \
		echo 'import gda_tracker_venv' > "$$site/gda_tracker_venv.pth"
	@touch $@

$(STAMPS)/test: $(STAMPS)/wheels requirements/test.txt
	$(say) 'installing the test tools'
	@$(call install,$(VENV),--constraint requirements/constraints.txt \
		--requirement requirements/test.txt)
	@touch $@

$(STAMPS)/benchmark: $(STAMPS)/wheels requirements/benchmark.txt
	$(say) 'installing Stone Soup'
	@$(call install,$(VENV),--constraint requirements/constraints.txt \
		--requirement requirements/benchmark.txt)
	@touch $@

# A list of files changes when one is added or removed, which time stamps do not show.
.PHONY: FORCE
FORCE:
define list_rule
$(STAMPS)/$(1).list: $(STAMPS)/venv FORCE
	@printf '%s\n' $(2) | cmp -s - $$@ || printf '%s\n' $(2) > $$@
endef

message_sources := $(sort $(wildcard msg_schemas/msg/*.msg)) msg_schemas/CMakeLists.txt \
	msg_schemas/package.xml
$(eval $(call list_rule,messages,$(message_sources)))

generator := $(if $(shell command -v ninja),Ninja,Unix Makefiles)

# Builds the message package in folder $(1) into the environment, under the name $(2), as build $(3).
build_messages = PATH="$(CURDIR)/$(BIN):$$PATH" AMENT_PREFIX_PATH="$(CURDIR)/$(VENV)" \
	sh -eu -c '\
		cmake -S $(1) -B $(SCRATCH)/$(2) -G "$(generator)" \
			-DCMAKE_BUILD_TYPE=$(3) \
			-DCMAKE_PREFIX_PATH="$(CURDIR)/$(VENV)" \
			-DCMAKE_INSTALL_PREFIX="$(CURDIR)/$(VENV)" \
			-DCMAKE_INSTALL_RPATH="\$$ORIGIN;\$$ORIGIN/../../.." \
			-DCMAKE_PROJECT_INCLUDE="$(CURDIR)/cmake/drop_missing_include_directories.cmake" \
			-DPython3_EXECUTABLE="$(CURDIR)/$(BIN)/python" \
			-DBUILD_TESTING=OFF -DPYTHON_ONLY=ON --no-warn-unused-cli && \
		cmake --build $(SCRATCH)/$(2) --parallel $(JOBS) && \
		if [ -f $(STAMPS)/$(2).manifest ]; then \
			xargs -d "\n" rm -f < $(STAMPS)/$(2).manifest; \
		fi && \
		cmake --install $(SCRATCH)/$(2) && \
		cp $(SCRATCH)/$(2)/install_manifest.txt $(STAMPS)/$(2).manifest' \
		> $(SCRATCH)/$(2).log 2>&1 || \
		{ tail -n 30 $(SCRATCH)/$(2).log; \
		  echo '[setup] the messages do not build; the whole log: $(SCRATCH)/$(2).log'; exit 1; }

# The environment is the ament prefix. Files of the previous build are removed from it first, and
# with another list of messages the build starts afresh: whole folders of generated files are
# installed, and a message that was renamed or removed would stay in them.
$(STAMPS)/messages: $(STAMPS)/wheels $(STAMPS)/messages.list $(message_sources) \
		$(wildcard cmake/*.cmake)
	$(say) 'building the messages (about one minute)'
	@mkdir -p $(SCRATCH)
	@for cause in messages.list wheels; do \
		if [ $(STAMPS)/$$cause -nt $@ ]; then rm -rf $(SCRATCH)/messages; fi; \
	done
	@$(call build_messages,msg_schemas,messages,Release)
	@cd / && "$(CURDIR)/$(BIN)/python" -c 'import gda_tracker_msgs.msg'
	@touch $@

# Messages of others, where no ROS installation brings their packages. Each configures for a while on
# one processor, so all are built at a time, and without optimisation: they are few and rare.
$(STAMPS)/foreign: $(STAMPS)/wheels scripts/write_message_packages.py \
		gda_tracker/io/foreign_types.py $(wildcard cmake/*.cmake)
	$(say) 'building the messages of other packages (about two minutes)'
	@mkdir -p $(SCRATCH)
	@names=$$($(BIN)/python scripts/write_message_packages.py $(SCRATCH)/foreign); \
	builds=''; \
	for name in $$names; do \
		export name; \
		( $(call build_messages,$(SCRATCH)/foreign/$$name,foreign_$$name,None) ) & \
		builds="$$builds $$!"; \
	done; \
	for build in $$builds; do wait $$build; done
	@touch $@

package_sources := $(sort $(shell find gda_tracker params launch data resource msg_schemas/msg \
	-type f ! -path '*/__pycache__/*' ! -name '.*' 2>/dev/null)) \
	package.xml setup.py setup.cfg pyproject.toml
$(eval $(call list_rule,package,$(package_sources)))

# pip knows no lib/gda_tracker, where ROS launch files look for the executables of nodes.
$(STAMPS)/package: $(STAMPS)/wheels $(STAMPS)/messages $(STAMPS)/package.list $(package_sources)
	$(say) 'installing gda_tracker'
	@rm -rf build/lib build/bdist.* *.egg-info
	@$(pip) install --force-reinstall --no-deps --no-build-isolation --no-index .
	@rm -rf build/lib build/bdist.* *.egg-info
	@rm -rf $(VENV)/lib/gda_tracker
	@mkdir -p $(VENV)/lib/gda_tracker
	@cd / && for script in $$("$(CURDIR)/$(BIN)/python" -c 'from importlib import metadata; \
	print(*(e.name for e in metadata.distribution("gda_tracker").entry_points))'); do \
		ln -s ../../bin/$$script "$(CURDIR)/$(VENV)/lib/gda_tracker/$$script"; \
	done
	@touch $@
	$(say) 'ready: $(BIN)/gda-tracker --help'

ifneq ($(shell cat $(OLDEST)/.stamps/venv 2>/dev/null),$(CURDIR))
.PHONY: $(OLDEST)/.stamps/venv
endif
# Python 3.11 or 3.12 first: the oldest numpy and scipy have no wheels for later ones.
$(OLDEST)/.stamps/venv:
	@python=$$(for p in $(PYTHON) python3 python3.12 python3.11; do \
		if $$p -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)))' \
			2>/dev/null; then echo $$p; break; fi; done); \
		python=$${python:-$$(requirements/check-tools.sh)}; \
		printf '[setup] creating $(OLDEST) with %s\n' "$$($$python --version)"; \
		$$python -m venv --clear $(OLDEST)
	@$(call install_uv,$(OLDEST))
	@mkdir -p $(@D)
	@echo '$(CURDIR)' > $@

$(OLDEST)/.stamps/oldest: $(OLDEST)/.stamps/venv requirements/oldest.txt
	$(say) 'installing the oldest supported numpy and scipy'
	@$(call install,$(OLDEST),--requirement requirements/oldest.txt)
	@touch $@
