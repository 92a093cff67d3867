#!/usr/bin/env bash
# The adaptive loader over camera paths: bench/loader.sh [SIZE]   [1024]
#
# Refinement and index a frame, working sets, and time to converge: simulated volumes of up to 16384^3 whose node records
# are made up, and a real store of SIZE^3. BENCH_DIR, KEEP, OCTAVO: see common.sh.
set -euo pipefail
source "$(dirname "$0")/common.sh"

size=${1:-1024}
check_size "$size"
voxels=$((size * size * size))
needs_room $((5 * voxels)) "a volume of $size^3 and a store of it" || exit 3
build
store="$work/loader_$size.octavo"
if [[ ! -f $store ]]; then
  make_volume "$size"
  say "making the store"
  "$octavo" convert "$raw" -o "$store" --json > "$work/convert.log"
  rm -f "$raw"
fi
warm "$store"
paths="$target/release/loader_paths"
say "frames"
"$paths" frames
say "working sets"
echo && "$paths" sets
say "store"
echo && "$paths" store "$store"
echo && provenance
