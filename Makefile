.PHONY: demo test lint setup-demo setup-test clean
VENV ?= .venv
BIN := $(VENV)/bin
DEMO_OUT ?= demo-output

setup-demo:
	@VENV=$(VENV) .ci/setup step,plot

setup-test:
	@VENV=$(VENV) .ci/setup test

demo: setup-demo
	$(BIN)/aspectgraph plan examples/nist_ctc_01_ap242.stp --entities examples/nist_ctc_01_entities.toml \
	    --camera examples/camera.toml --accuracy 0.99 --probability 0.9 --out $(DEMO_OUT)

lint: setup-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

test: lint
	$(BIN)/python -m pytest
	$(BIN)/python -m pytest --nbmake notebooks

clean:
	rm -rf $(DEMO_OUT) build *.egg-info
	find aspectgraph errors ga planner -name '*.nb[ic]' -delete
