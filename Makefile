.PHONY: demo test lint docs wheel versions fuzz coverage sbom setup-demo setup-test setup-docs clean
VENV ?= .venv
BIN := $(VENV)/bin
DEMO_OUT ?= demo-output

setup-demo:
	@VENV=$(VENV) .ci/setup step,plot

setup-test:
	@VENV=$(VENV) .ci/setup test

setup-docs:
	@VENV=$(VENV) .ci/setup docs

demo: setup-demo
	$(BIN)/aspectgraph plan examples/nist_ctc_01_ap242.stp --entities examples/nist_ctc_01_corners.toml \
	    --camera examples/camera.toml --accuracy 0.99 --probability 0.9 --out $(DEMO_OUT)
	$(BIN)/aspectgraph plan examples/nist_ctc_01_ap242.stp --dimensions all --camera examples/camera.toml \
	    --accuracy 0.999 --probability 0.9 --sigma-mm 0.05 --sigma-rad 0.001 --out $(DEMO_OUT)/dimensions

lint: setup-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/mypy

docs: setup-docs
	$(BIN)/mkdocs build --strict --quiet

test: lint
	$(BIN)/mkdocs build --strict --quiet
	$(BIN)/python -m pytest
	$(BIN)/python -m pytest --nbmake notebooks

wheel:
	.ci/wheel

versions:
	.ci/versions

FUZZ_SECONDS ?= 600

fuzz: setup-test
	$(BIN)/python benchmarks/fuzz.py --seconds $(FUZZ_SECONDS)

# compiled loops are counted in a second pass, uncompiled, by tests that are quick without the compiler
UNCOMPILED := tests/planner/cover tests/errors/test_errors_quantization.py tests/errors/test_errors_expansion.py \
    tests/planner/bound/test_excluded_pairs.py tests/planner/bound/test_least_image.py

coverage:
	@VENV=$(VENV) .ci/setup coverage
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest
	NUMBA_DISABLE_JIT=1 $(BIN)/coverage run -m pytest $(UNCOMPILED)
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report --skip-covered --sort=miss

sbom: setup-test
	$(BIN)/python .ci/supply.py sbom build/sbom.cdx.json

clean:
	rm -rf $(DEMO_OUT) build site *.egg-info
	find aspectgraph errors ga planner -name '*.nb[ic]' -delete
