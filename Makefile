# Two commands set everything up on a fresh machine: make demo, make test.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.installed

.PHONY: demo test test-all bench lint clean

$(STAMP): constraints.txt setup.cfg pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable ".[test]"
	touch $(STAMP)

demo: $(STAMP)  ## energies of rough gold, glass and chalk, order by order, in all models
	@$(BIN)/torchms energy --material conductor --metal Au --alpha 0.5 --max-order 6 --samples 3e5
	@echo
	@$(BIN)/torchms energy --material dielectric --eta 1.5 --alpha 0.5 --max-order 6 --samples 3e5
	@echo
	@$(BIN)/torchms energy --material diffuse --albedo 0.9 --alpha 0.5 --max-order 6 --samples 3e5

# Two processes with one thread each: the statistics are many small blocks.
test: $(STAMP)  ## the suite without the slow checks
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 -m "not slow"

test-all: $(STAMP)  ## the whole suite
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

bench: $(STAMP)  ## throughput of the evaluators on this machine
	$(BIN)/python benchmarks/throughput.py

clean:
	rm -rf .venv
