# Two commands set everything up on a fresh machine: make demo, make test.
PYTHON ?= python3
BIN := .venv/bin
CORE := .venv/.core
STAMP := .venv/.installed
DOCS := .venv/.docs

.PHONY: demo demo-fit test test-all node-test lab lab-check lab-picture coverage mutations bench pictures figures tables layered distil export docs docs-check theory-figures lint clean

INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable

# The demo needs no extra: it runs before what the tests need is there.
$(CORE): constraints.txt setup.cfg pyproject.toml
	$(PYTHON) -m venv .venv
	$(INSTALL) .
	touch $(CORE)

$(STAMP): $(CORE)
	$(INSTALL) ".[test]"
	touch $(STAMP)

$(DOCS): $(STAMP)
	$(INSTALL) ".[docs]"
	touch $(DOCS)

demo: $(CORE)  ## energies of rough gold, glass and chalk, order by order, in four models
	@$(BIN)/torchms energy --material conductor --metal Au --alpha 0.5 --max-order 6 --samples 1e5
	@echo
	@$(BIN)/torchms energy --material dielectric --eta 1.5 --alpha 0.5 --max-order 6 --samples 1e5
	@echo
	@$(BIN)/torchms energy --material diffuse --albedo 0.9 --alpha 0.5 --max-order 6 --samples 1e5
	@echo
	@echo "How to read them: row 1 is all that a classic model of one bounce returns, the total what there is. invariance and height-walk"
	@echo "are exact for Smith's theory of rough surfaces; uncorrelated and correlated are off by as much as they differ from those."

# Two processes with one thread each: the statistics are many small blocks. glibc keeps what is freed: pages given back and
# taken again are half of the time of the quadratures in GTR.
PYTEST := OMP_NUM_THREADS=1 MALLOC_MMAP_THRESHOLD_=33554432 MALLOC_TRIM_THRESHOLD_=1073741824 $(BIN)/python -m pytest

test: $(STAMP)  ## the suite without the slow checks
	$(PYTEST) -n 2 -m "not slow"

test-all: $(STAMP)  ## the whole suite, with the types of all calls inside the package
	$(PYTEST) -n 2 --jaxtyping-packages=torchms,beartype.beartype

pictures: $(STAMP)  ## the picture at the head of the README; two furnaces, gold and glass for the docs (about five minutes)
	$(BIN)/python -m tools.hero docs/images/hero.png
	$(BIN)/python -m tools.pictures docs/images

demo-fit: $(STAMP)  ## inverse rendering of gold and glass, with all bounces and with one; docs/images/fit.png
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/fit.py

figures: $(STAMP)  ## lobes of explicit surfaces against the models (3 materials x 4 roughnesses), G1 of GTR, bounded normals
	$(BIN)/python benchmarks/microsurface_figures.py --out docs/figures --rays 2e6 --walks 5e5 --surfaces 8
	$(BIN)/python benchmarks/gtr_figures.py
	$(BIN)/python benchmarks/bounded_normals.py

tables: $(STAMP)  ## the albedo tables of the compensations, a few minutes
	$(BIN)/python -m tools.generate_tables

layered: $(STAMP)  ## the table of MetallicRoughness, after make distil: ten seconds
	$(BIN)/python -m tools.generate_layered

distil: $(STAMP)  ## the lobes of Distilled, from a seed to the files in the package: metal about half an hour on two idle cores, then glass and diffuse facets
	$(BIN)/python -m torchms.approximations.distil --distribution GGX --blocks 48 --force --out torchms/approximations/distilled_ggx_metal.npz
	$(BIN)/python -m torchms.approximations.distil --distribution Beckmann --force --out torchms/approximations/distilled_beckmann_metal.npz
	$(BIN)/python -m torchms.approximations.distil.glass --distribution GGX --blocks 12 --widths 36 28 --each 16 --cells 3072 --force --outs torchms/approximations/distilled_ggx_reflected.npz torchms/approximations/distilled_ggx_transmitted.npz
	$(BIN)/python -m torchms.approximations.distil.glass --distribution Beckmann --force --outs torchms/approximations/distilled_beckmann_reflected.npz torchms/approximations/distilled_beckmann_transmitted.npz
	$(BIN)/python -m torchms.approximations.distil.diffuse --distribution GGX --blocks 96 --widths 30 26 --steps 60 --force --out torchms/approximations/distilled_ggx_diffuse.npz
	$(BIN)/python -m torchms.approximations.distil.diffuse --distribution Beckmann --blocks 96 --widths 30 26 --steps 60 --force --out torchms/approximations/distilled_beckmann_diffuse.npz

export: $(STAMP)  ## the set of ONNX files with its parity table
	$(BIN)/python -m export

docs: $(DOCS)  ## the documentation, build/docs/index.html, with the lobe lab if `make lab` built it; warnings are errors
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet -b html docs build/docs

docs-check: docs  ## no broken link, no missing picture; in headless Chromium, if there is one: all pages load, the search works
	$(BIN)/python -m tools.check_site build/docs

theory-figures: $(STAMP)  ## the figures of the pages of the theory, docs/images/theory (a minute)
	$(BIN)/python benchmarks/theory_figures.py

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python

coverage: $(STAMP)  ## statements of torchms that the suite runs
	$(PYTEST) -n 2 -m "not slow" --cov --cov-report=term-missing:skip-covered

mutations: $(STAMP)  ## deliberate faults in formulas, and the test that catches each
	$(BIN)/python tests/mutations.py

node-test: $(STAMP)  ## exported files in ONNX Runtime for Node
	npm ci --ignore-scripts --prefix tests/onnx/node
	$(PYTEST) tests/onnx/test_outside_python.py

# An evaluator is written anew when its numbers change (a retrained network, a table); after changes of the code that matter to it,
# `python -m export.lab_set --force` writes them all.
LAB := export/lab
LAB_MODELS := $(LAB)/public/models/models.json

$(LAB)/node_modules/.package-lock.json: $(LAB)/package.json $(LAB)/package-lock.json
	npm ci --ignore-scripts --no-audit --no-fund --prefix $(LAB)

# Interrupted, make lab goes on where it was: the list says what is there.
.PRECIOUS: $(LAB_MODELS)
$(LAB_MODELS): $(STAMP) export/lab_set.py export/diagrams.py $(wildcard torchms/approximations/*.npz)
	$(BIN)/python -m export.lab_set

lab: $(LAB)/node_modules/.package-lock.json $(LAB_MODELS)  ## the lobe lab, a static folder build/lab; `torchms lab` shows it (the first time about 20 minutes)
	npm run build --prefix $(LAB)

lab-check: $(LAB)/node_modules/.package-lock.json  ## types, unit tests and build of the lab, without its evaluators
	npm run check --prefix $(LAB)
	npm test --prefix $(LAB)
	npm run build --prefix $(LAB) -- --outDir ../../build/lab-check

lab-picture: lab  ## docs/images/lab.png, by headless Chromium
	node $(LAB)/drive/screenshot.mjs docs/images/lab.png --size 1360x860 --dark --hash "$(LAB_STATE)"

LAB_STATE := \#alpha=0.8&metal=Ag&theta=45&outTheta=30

bench: $(STAMP)  ## throughput of the evaluators on this machine, then ratios to scalar code and Mitsuba
	$(BIN)/python benchmarks/throughput.py
	$(BIN)/python benchmarks/speed.py
	$(BIN)/python benchmarks/memory.py

clean:
	rm -rf .venv build
