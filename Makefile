# `make run` shows the instrument at work on its emulated rig; `make help` lists the rest.

.DEFAULT_GOAL := help
.PHONY: help build run validate test test-doc test-page test-python test-module test-qa test-service test-features test-slurm qa fuzz tutorial lint bench deb
.PHONY: deb-test offline offline-test wheel release-python web contract deny deps-build deps-web deps-python deps-test deps-slurm deps-bench deps-package
.PHONY: deps-machine

CARGO ?= cargo
# Arguments for `carved simulate`: make run ARGS="--listen 127.0.0.1:8085"
ARGS ?=
# The look of the emulated frames: real or clean.
FRAMES ?= real
TARGET_DIR := $(or $(CARGO_TARGET_DIR),target)
CARGO_DENY_VERSION := 0.20.2
WASM := wasm32-unknown-unknown

NODE_MODULES := web/node_modules/.package-lock.json
PAGE := web/dist/index.html.gz
PAGE_SOURCES := $(wildcard web/src/*.* web/src/setup/* web/src/wall/* web/src/docs/* docs/*.md docs/*.png docs/*/*.svg *.md clients/python/*.md) web/build.mjs web/docs.mjs

help: ## this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 22

build: deps-build $(PAGE) ## the daemon, release, with the operator's page inside: target/release/carved, its symbols beside it
	$(CARGO) build --release --locked
	scripts/split-symbols $(TARGET_DIR)/release/carved

run: build ## build, then the emulated rig with its demo plate (ARGS="..." goes to carved simulate)
	$(TARGET_DIR)/release/carved simulate --frames $(FRAMES) $(ARGS)

# The daemon that the page, the Python client and the rows of reliability are tested against is the one that is built for the integration
# tests, so that nothing is compiled twice.
test: deps-build deps-test deps-python $(PAGE) ## unit, integration and doc tests; the page's in headless Chromium; the Python client's and module's; short rows of reliability; the unit file
	CARGO="$(CARGO)" scripts/test

test-doc:
	$(CARGO) test --workspace --doc --locked

test-page test-python test-module test-qa test-service: export CARVED_BIN = $(abspath $(TARGET_DIR))/debug/carved

test-page:
	cd web && npm run --silent test
	cd web && npm run --silent test:browser

test-python:
	clients/python/check test

test-module:
	python/check test

# The rows of `make qa` that take seconds in their short form. In that form they judge no time below a second.
test-qa:
	python3 -m tests.reliability --binary "$(CARVED_BIN)" --scale short R9 R10 R15 R16 R17 R19 R20

test-service:
	systemd/verify.sh

# ROW="R1 R13" selects rows, SCALE=full their size; CONTROL=1 breaks what each row names, so that every row must report a miss.
qa: build deps-python deps-test ## attacks the release program from outside, row by row: docs/reliability.md (ROW=R13 SCALE=full CONTROL=1)
	python3 -m tests.reliability --binary "$(abspath $(TARGET_DIR))/release/carved" --write --scale $(or $(SCALE),default) $(if $(CONTROL),--control) $(ROW)

# TARGET="http ply" selects parsers, SECONDS=60 the time for each; KEEP=1 adds what reaches new code to the corpus.
fuzz: deps-build ## searches for inputs at which a parser panics, hangs or takes all memory, guided by coverage: 20 s each (TARGET=http SECONDS=60)
	CARGO="$(CARGO)" fuzz/run $(if $(KEEP),--keep) $(or $(SECONDS),20) $(TARGET)

validate: deps-build ## measures simulated specimens of known size and writes docs/validation.md, which takes hours (ARGS="--only look --out /tmp/look")
	$(CARGO) run --release --locked --package carved-validate -- $(or $(ARGS),--out docs)

tutorial: build deps-python ## follows docs/tutorial.md as written, and compares every output with the page
	python3 tests/docs/follow_tutorial.py "$(abspath $(TARGET_DIR))/release/carved"

test-features: deps-build deps-python ## what is not in the default build: Parquet tables, and archives in an object store, on the S3 of moto
	$(CARGO) test --locked --features s3,parquet --lib --test commands -- --include-ignored object_store:: parquet

test-slurm: deps-build deps-slurm ## examples/slurm on a Slurm of this machine, which is installed where missing (as root, takes minutes)
	$(CARGO) test --locked --test commands slurm:: -- --ignored --nocapture

# Clippy reads all code with every feature, and then what no feature at all changes: the program of `make offline`, and the science for wasm32.
CLIPPY = $(CARGO) clippy --locked
STRICT = -D warnings

lint: deps-build deps-python $(NODE_MODULES) ## formatting, clippy with every feature, builds with other features, types and formatting of page and Python client
	$(CARGO) fmt --all --check
	$(CARGO) fmt --manifest-path fuzz/Cargo.toml --check
	$(CLIPPY) --workspace --all-targets --features s3,parquet -- $(STRICT)
	$(CLIPPY) -p carved --no-default-features -- $(STRICT)
	@if [ -d "$$(rustc --print target-libdir --target $(WASM))" ] || why=$$(timeout 120 rustup target add $(WASM) 2>&1); then \
		set -x; $(CLIPPY) -p carved-core --no-default-features --target $(WASM) -- $(STRICT); \
	else \
		echo "carved-core is not checked for $(WASM): rustup target add $(WASM) failed: $$why"; \
		$(CLIPPY) -p carved-core --no-default-features -- $(STRICT); \
	fi
	cd web && npm run --silent check
	clients/python/check lint
	python/check lint

bench: deps-build deps-bench ## benchmarks, then other tools beside carved: docs/performance.md
	$(CARGO) bench --workspace --locked
	benches/peers/run.sh

wheel: deps-build deps-python ## the Python module: python/dist/carved-*.whl
	python/check wheel

release-python: deps-build deps-python ## what goes to PyPI, built and checked: python/dist (python/release --upload publishes it)
	python/release

offline: deps-build ## carved for the nodes of a cluster, without libraries: target/offline/carved-VERSION-x86_64-linux.tar.gz
	scripts/build-offline

offline-test: offline build ## runs that tarball in an empty root and compares its numbers with those of the normal program
	tests/package/offline $(TARGET_DIR)/offline/carved-*-x86_64-linux.tar.gz $(TARGET_DIR)/release/carved

deb: build deps-package ## Debian packages of the program and of its symbols: target/deb
	scripts/build-deb

# The same program with a higher version stands for a newer one.
deb-test: deb deps-machine ## installs the package in a booted systemd and does with it what a lab does (as root)
	$(CARGO) build --release --locked -p hardware-sim --example rig
	DEB_VERSION=999 scripts/build-deb $(TARGET_DIR)/deb/newer
	tests/package/deb $(TARGET_DIR)/deb/carved_*.deb $(TARGET_DIR)/deb/newer/carved_*.deb $(TARGET_DIR)/release/examples/rig

web: $(PAGE) ## the operator's page alone: web/dist

contract: deps-build $(NODE_MODULES) ## after a change of the API or a setting: docs/openapi.json, the page's types, docs/configuration.md, docs/tables.md
	CARVED_UPDATE_OPENAPI=1 $(CARGO) test --locked --test http openapi_file
	CARVED_UPDATE_CONFIGURATION=1 CARVED_UPDATE_TABLES=1 $(CARGO) test --locked --test commands reference_page
	cd web && npm run --silent contract

deny: ## licences, banned crates and sources of everything that is built in (installs cargo-deny where missing)
	command -v cargo-deny >/dev/null || $(CARGO) install cargo-deny --locked --version $(CARGO_DENY_VERSION)
	$(CARGO) deny --locked check licenses bans sources

deps-build:
	@scripts/install-deps build

deps-web:
	@scripts/install-deps web

deps-python:
	@scripts/install-deps python

deps-test:
	@scripts/install-deps test

deps-package:
	@scripts/install-deps package

deps-machine:
	@scripts/install-deps machine

deps-slurm:
	@scripts/install-deps slurm

# What cannot be installed is skipped with its reason.
deps-bench:
	-@scripts/install-deps bench

$(NODE_MODULES): web/package-lock.json web/package.json | deps-web
	cd web && npm ci --ignore-scripts --no-audit --no-fund
	@touch $@

$(PAGE): $(PAGE_SOURCES) $(NODE_MODULES) | deps-web
	cd web && npm run --silent build
