.PHONY: demo test golden lint types style compile pages docs wheel versions loops fuzz coverage sbom setup-demo setup-test setup-docs clean
VENV ?= .venv
BIN := $(VENV)/bin
DEMO_OUT ?= demo-output
# tests of a file share what they set up, so a file stays with one worker
WORKERS ?= auto
# in the order of tests/conftest.py: what takes longest comes first, and no worker is left alone with it
IN_PARALLEL := -n $(WORKERS) --dist loadfile --no-loadscope-reorder

setup-demo:
	@VENV=$(VENV) .ci/setup step

setup-test:
	@VENV=$(VENV) .ci/setup test

setup-docs:
	@VENV=$(VENV) .ci/setup docs

# what a file states about its tolerances, then the lengths of chosen edges
demo: setup-demo
	$(BIN)/aspectgraph plan examples/nist_ctc_01_ap242.stp --dimensions all --no-positions --camera examples/camera.toml \
	    --share 0.3 --accuracy 0.999 --probability 0.9 --sigma-mm 0.05 --sigma-rad 0.001 \
	    --light dome:0,0,0,1200,20 --register edges \
	    --effort quick --out $(DEMO_OUT)
	$(BIN)/aspectgraph plan examples/nist_ctc_01_ap242.stp --entities examples/nist_ctc_01_corners.toml \
	    --camera examples/camera.toml --accuracy 0.99 --probability 0.9 --effort quick --out $(DEMO_OUT)/edges

# side by side: mypy takes as long as all else, on one core
lint: setup-test
	@$(MAKE) --no-print-directory -j 2 --output-sync=target types style

types:
	$(BIN)/mypy

style:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

# two tests that run at once would both compile what they need
compile:
	$(BIN)/python -m ground.leader

pages:
	$(BIN)/mkdocs build --strict --quiet

docs: setup-docs
	@$(MAKE) --no-print-directory pages

test: setup-test
	@$(MAKE) --no-print-directory -j 2 --output-sync=target types compile style pages
	$(BIN)/python -m pytest $(IN_PARALLEL) --nbmake tests notebooks

wheel:
	.ci/wheel

versions:
	.ci/versions

# ground/loops.json: which loops are compiled ahead, and in which order
loops: setup-demo
	$(BIN)/python .ci/record_loops.py

# what the program decides, compared with .ci/golden.json; RECORD=1 writes that file anew
golden: setup-demo
	$(BIN)/python .ci/golden.py $(if $(RECORD),--record)

FUZZ_SECONDS ?= 600

fuzz: setup-test
	$(BIN)/python benchmarks/running/fuzz.py --seconds $(FUZZ_SECONDS)

# What the compiler makes of loops is not counted, so marked tests run a second time without it.
coverage:
	@VENV=$(VENV) .ci/setup coverage
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest $(IN_PARALLEL)
	NUMBA_DISABLE_JIT=1 $(BIN)/coverage run -m pytest $(IN_PARALLEL) -m uncompiled
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report --skip-covered --sort=miss
	$(BIN)/coverage json --quiet -o - | $(BIN)/python .ci/covered.py

sbom: setup-test
	$(BIN)/python .ci/supply.py sbom build/sbom.cdx.json

clean:
	rm -rf $(DEMO_OUT) build site *.egg-info
	find aspectgraph ground errors ga planner \( -name '*.nb[ic]' -o -name 'ahead-*' \) -delete
