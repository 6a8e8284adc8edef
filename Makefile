# `make demo` and `make test` set up .venv themselves; a second call finds it ready.
PYTHON ?= python3
WORKERS ?= 2
BIN := .venv/bin

.PHONY: demo edit test lint check clean

demo: .venv/run.stamp
	$(BIN)/deformer demo

edit: .venv/run.stamp
	$(BIN)/deformer edit

# Threads that spin while they wait would take the cores from the other workers.
test: .venv/test.stamp
	OMP_WAIT_POLICY=PASSIVE OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n $(WORKERS)

lint: .venv/test.stamp
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright --pythonpath $(BIN)/python

check: lint test

.venv/run.stamp: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[app]"
	touch $@

.venv/test.stamp: .venv/run.stamp
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[app,test]"
	touch $@

clean:
	rm -rf .venv demo-out
