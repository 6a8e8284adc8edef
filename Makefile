# `make demo` and `make test` set up .venv themselves; a second call finds it ready.
PYTHON ?= python3
# Tests wait for processes and windows: three workers keep two cores busy.
WORKERS ?= 3
BIN := .venv/bin

.PHONY: demo edit docs test test-quick test-oldest test-processors interop fuzz soak lint check clean

demo: .venv/run.stamp
	$(BIN)/deformer demo

edit: .venv/run.stamp
	$(BIN)/deformer edit

# Threads that spin while they wait would take the cores from the other workers.
CALM := OMP_WAIT_POLICY=PASSIVE OPENBLAS_NUM_THREADS=1
QUICK := -m "not slow and not window"
# All tests of a file by one worker: what they share is made once.
SPREAD := -n $(WORKERS) --dist loadfile

test: .venv/test.stamp
	$(CALM) $(BIN)/pytest $(SPREAD)

test-quick: .venv/test.stamp
	$(CALM) $(BIN)/pytest $(SPREAD) $(QUICK)

# The oldest versions of what pyproject.toml asks for. Numba keeps one version's kernels a folder.
test-oldest: .venv-oldest/test.stamp
	$(CALM) NUMBA_CACHE_DIR=$(CURDIR)/.venv-oldest/kernels .venv-oldest/bin/pytest $(SPREAD)

# Kernels, BLAS and torch of older processors, which round differently; one core in place of all.
test-processors: .venv/test.stamp
	NUMBA_CPU_NAME=haswell OPENBLAS_CORETYPE=Haswell ATEN_CPU_CAPABILITY=avx2 \
	  NUMBA_CACHE_DIR=$(CURDIR)/.venv/kernels-haswell $(CALM) $(BIN)/pytest $(SPREAD) $(QUICK)
	NUMBA_CPU_NAME=generic OPENBLAS_CORETYPE=Nehalem ATEN_CPU_CAPABILITY=default \
	  NUMBA_CACHE_DIR=$(CURDIR)/.venv/kernels-generic $(CALM) $(BIN)/pytest $(SPREAD) $(QUICK)
	OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 taskset -c 0 $(BIN)/pytest $(QUICK)

# Other programs read what this one writes: Blender as a Python module (3.11), and, in
# node, three.js and the Khronos validator. Hundreds of megabytes are downloaded once.
interop: .venv/test.stamp .venv-interop/run.stamp
	DEFORMER_BLENDER_PYTHON=$(CURDIR)/.venv-interop/bin/python \
	  DEFORMER_NODE_FOLDER=$(CURDIR)/.venv-interop $(CALM) $(BIN)/pytest tests/interop

# New damaged files for every reader, for so many minutes; inputs that fail are kept.
FUZZ_MINUTES ?= 20
fuzz: .venv/test.stamp
	$(BIN)/python tests/fuzz/fuzz.py --minutes $(FUZZ_MINUTES)

# Hours: random edits of the solver, and every kill test at all its moments.
soak: .venv/test.stamp
	DEFORMER_KILLS=20 $(CALM) $(BIN)/pytest tests/kills
	$(CALM) $(BIN)/python benchmarks/solver_soak.py

# The manual, as a folder that opens from disk: build/site/index.html. A link that leads nowhere, a
# public name without a page, an example or the shapes of its arrays, and what would be fetched from
# elsewhere end it (not with --quiet).
# The variable silences an advertisement.
docs: .venv/docs.stamp
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo "open build/site/index.html"

lint: .venv/test.stamp
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright --pythonpath $(BIN)/python

check: lint test

# $(call environment,FOLDER,PYTHON): made again if its pip is missing, as where Debian's python3-venv
# was; an older Python is told before it has made one.
define environment
	@$(1)/bin/python -m pip --version >/dev/null 2>&1 || { \
	  $(2) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	    echo "Python 3.11 or newer is needed: make PYTHON=python3.12, for example" >&2; exit 1; }; \
	  $(2) -m venv $(1); }
	@echo "installing packages into $(1): some minutes the first time"
endef

.venv/run.stamp: pyproject.toml constraints.txt
	$(call environment,.venv,$(PYTHON))
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[app]"
	touch $@

.venv/test.stamp: .venv/run.stamp
	$(call environment,.venv,$(PYTHON))
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[app,test]"
	touch $@

.venv/docs.stamp: .venv/run.stamp
	$(call environment,.venv,$(PYTHON))
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[app,docs]"
	touch $@

.venv-oldest/test.stamp: pyproject.toml constraints-oldest.txt
	$(call environment,.venv-oldest,$(PYTHON))
	.venv-oldest/bin/python -m pip install --quiet --constraint constraints-oldest.txt --editable ".[app,test]"
	touch $@

INTEROP_PYTHON ?= python3.11
.venv-interop/run.stamp: constraints-interop.txt
	$(call environment,.venv-interop,$(INTEROP_PYTHON))
	.venv-interop/bin/python -m pip install --quiet --constraint constraints-interop.txt bpy
	npm install --silent --no-fund --no-audit --prefix .venv-interop \
	  gltf-validator@2.0.0-dev.3.10 three@0.187.0
	touch $@

clean:
	rm -rf .venv .venv-oldest .venv-interop demo-out build/site
