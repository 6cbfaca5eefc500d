# Two commands set everything up on a fresh machine: make demo, make test.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.installed

.PHONY: demo test test-all bench pictures figures export lint clean

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

pictures: $(STAMP)  ## the pictures of the README
	mkdir -p docs/images
	$(BIN)/torchms render sphere --light constant --samples 32 --width 200 --height 200 --force \
		--bsdf "RoughConductor(GGX(1.0), Ideal(), SingleBounce())" --out docs/images/furnace_single_bounce.png
	$(BIN)/torchms render sphere --light constant --samples 32 --width 200 --height 200 --force \
		--bsdf "RoughConductor(GGX(1.0), Ideal(), Bidirectional(Invariance(), max_order=10))" \
		--out docs/images/furnace_all_bounces.png
	$(BIN)/torchms render sphere --intensity 4 --samples 32 --width 200 --height 200 --force \
		--bsdf "RoughConductor(GGX(0.5), Conductor.metal('Au'), Bidirectional(Invariance(), max_order=8))" \
		--out docs/images/gold.png

figures: $(STAMP)  ## lobes of explicit surfaces against the models, 3 materials x 4 roughnesses
	$(BIN)/python benchmarks/microsurface_figures.py --out docs/figures

export: $(STAMP)  ## the set of ONNX files with its parity table
	$(BIN)/python -m export

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

bench: $(STAMP)  ## throughput of the evaluators on this machine
	$(BIN)/python benchmarks/throughput.py

clean:
	rm -rf .venv
