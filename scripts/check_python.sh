#!/usr/bin/env bash
# The Python package: its wheel, built with the release artifacts of the workspace, its tests, and its documentation as web pages, in
# a virtual environment that is made here. What is not installed there (torch, taichi, warp-lang) is skipped, visibly.
set -euo pipefail
cd "$(dirname "$0")/../python"
folder=${CARGO_TARGET_DIR:-$PWD/../target}/python
if ! python3 -m venv --clear "$folder/venv" 2>/dev/null; then
  apt-get update -qq && apt-get install -y -qq python3-venv
  python3 -m venv --clear "$folder/venv"
fi
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1 PYTHONPATH=
"$folder/venv/bin/pip" install --quiet --only-binary :all: --requirement requirements.txt
rm -rf "$folder/wheels"
# Fails where the wheel needs a library that not every Linux has.
"$folder/venv/bin/maturin" build --release --locked --auditwheel check --out "$folder/wheels"
"$folder/venv/bin/pip" install --quiet --no-deps "$folder"/wheels/*.whl
# From where no module of this folder is found by chance.
cd tests
"$folder/venv/bin/pytest" -p no:cacheprovider -q -rs .
# Fails on names that are documented and not there.
"$folder/venv/bin/python" -W error -m pdoc --output-directory "$folder/docs" gic gic.jax
echo "documentation: $folder/docs/gic.html"
