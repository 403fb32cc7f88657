# Everything runs in a virtual environment of its own; nothing but Python 3.10 or newer and make is needed.
PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
DEMO ?= demo
# One test process a core: numpy's own threads would only get in each other's way.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: demo test lint bench bench-drag figures clean panel resources screenshots

demo: $(VENV)/figures.stamp
	$(BIN)/la-flatten demo --output $(DEMO)

test: $(VENV)/test.stamp
	$(BIN)/python -m pytest -n auto

lint: $(VENV)/lint.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(VENV)/bench.stamp
	$(BIN)/python Testing/Benchmarks/bench_flattening.py
	$(BIN)/python Testing/Benchmarks/bench_distortion.py
	$(BIN)/python Testing/Benchmarks/bench_independence.py
	$(BIN)/python Testing/Benchmarks/bench_remeshing.py
	$(BIN)/python Testing/Benchmarks/bench_seeds.py
	$(BIN)/python Testing/Benchmarks/bench_stress.py
	$(BIN)/python Testing/Benchmarks/bench_labels.py
	$(BIN)/python Testing/Benchmarks/bench_preparation.py
	$(BIN)/python Testing/Benchmarks/bench_peers.py

# How quickly the map follows a seed that is dragged in the panel.
bench-drag: $(VENV)/test.stamp
	$(BIN)/python Testing/Benchmarks/bench_drag.py

# The counterparts of the paper's figures, on the phantom and on real atria where they are found, into Docs/figures/.
figures: $(VENV)/figures.stamp
	PYTHONPATH=Testing/Benchmarks $(BIN)/python Testing/Figures/make_figures.py

# The module in a window of its own, for those without Slicer.
panel: $(VENV)/test.stamp
	PYTHONPATH=Testing/Host $(BIN)/python -m slicer_host.desktop LAFlattening/LAFlattening.py

# Icon, thumbnail and seed diagrams of the module, drawn from the phantom and the template.
resources: $(VENV)/figures.stamp
	$(BIN)/python Testing/Tools/draw_resources.py

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
	  || { echo "LAFlattening needs Python 3.10 or newer; try: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	@$(PYTHON) -m venv $(VENV) \
	  || { rm -rf $(VENV); echo "Python's venv module is missing (Debian: apt-get install python3-venv)"; exit 1; }

# A stamp for each set of optional packages, made again when the packages asked for change.
$(VENV)/%.stamp: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[$*]'
	@touch $@

clean:
	rm -rf $(VENV) demo

# The pictures of README and guides; the module's need off-screen OpenGL (Debian: libegl1 libgl1-mesa-dri).
screenshots: demo $(VENV)/test.stamp
	mkdir -p Screenshots
	cp $(DEMO)/figure.png Screenshots/map.png
	$(BIN)/python Testing/Tools/draw_prepared.py
	$(BIN)/python Testing/Tools/screenshots.py
