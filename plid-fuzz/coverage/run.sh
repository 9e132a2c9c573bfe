#!/usr/bin/env bash
# Gives one reader inputs that libFuzzer makes from the code that they reach: `run.sh READER [OPTION...]`, with options
# of libFuzzer such as `-max_total_time=600`. READER is the name of a folder in `plid-fuzz/corpus`. Needs a compiler of
# C++.
set -euo pipefail
reader=${1:?which reader? See plid-fuzz/corpus}
shift
cd "$(dirname "$0")"
target=${CARGO_TARGET_DIR:-$PWD/target}
host=$(rustc -vV | sed -n 's/^host: //p')

# The stable compiler has LLVM's pass that counts the edges of the code. With --target, build scripts do without it.
export RUSTFLAGS="-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table
    -Cllvm-args=-sanitizer-coverage-trace-compares"
cargo build --release --target "$host" --target-dir "$target"

# Inputs that reach new code are kept from run to run. The corpus of the tests is read, and not changed.
found=$target/found/$reader
mkdir -p "$found" "$target/faults"
# As in any program of Rust, a pipe that its reader has closed is an error, and does not end the process.
trap '' PIPE
PLID_FUZZ_TARGET=$reader exec "$target/$host/release/readers" "$found" "$PWD/../corpus/$reader" \
    -artifact_prefix="$target/faults/$reader-" -max_len=16384 -timeout=60 -rss_limit_mb=4096 "$@"
