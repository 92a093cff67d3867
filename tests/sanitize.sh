#!/usr/bin/env bash
# ThreadSanitizer over what runs on several threads: the loader's queue, conversions (threads that write and map the same scratch files), and the
# server. Needs a nightly compiler with rust-src: rustup toolchain install nightly -c rust-src
set -euo pipefail
cd "$(dirname "$0")/.."
host=$(rustc -vV | sed -n 's/^host: //p')
export RUSTFLAGS=-Zsanitizer=thread CARGO_TARGET_DIR=target/sanitize PROPTEST_CASES=${PROPTEST_CASES:-10}
# A race ends a test with 66, so that none can pass unseen.
export TSAN_OPTIONS="halt_on_error=1 exitcode=66 second_deadlock_stack=1 suppressions=$PWD/tests/sanitize.supp"
test() { cargo +nightly test -Zbuild-std --target "$host" --profile test "$@"; }
test -p octree-store --test loader
test -p octree-store --lib -- loader
test -p preprocess --test laws
test -p serve --test http
