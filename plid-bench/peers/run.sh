#!/usr/bin/env bash
# Installs and builds every peer, runs all of them against plid, prints the tables and writes out/peers.json.
# Needs Rust, Python 3.11 (or PYTHON=...) and package registries; options go to compare.py (see `./run.sh --help`).
set -euo pipefail
cd "$(dirname "$0")"

python=${PYTHON:-python3.11}
if [ ! -x .venv/bin/python ]; then
    "$python" -m venv .venv
fi
.venv/bin/python -m pip install --quiet --requirement requirements.txt
cargo build --release
exec .venv/bin/python compare.py "${CARGO_TARGET_DIR:-target}/release/plid-peers" "$@"
