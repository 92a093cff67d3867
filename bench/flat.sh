#!/usr/bin/env bash
# What a voxel costs at several sizes: bench/flat.sh [SIZE...]   [256 512 1024 2048]
#
# One size at a time; its volume is deleted before the next is made (2048^3 is 17 GB). A size that does
# not fit the disk is left out with a remark. BENCH_DIR, KEEP, OCTAVO, RUNS: see common.sh.
set -euo pipefail
source "$(dirname "$0")/common.sh"

sizes=("$@")
((${#sizes[@]})) || sizes=(256 512 1024 2048)
for size in "${sizes[@]}"; do check_size "$size"; done
build
lines=()
for size in "${sizes[@]}"; do
  voxels=$((size * size * size))
  # The raw file, and a store with overlap and pyramid: 2 and 1.7 bytes a voxel.
  if ! needs_room $((4 * voxels)) "$size^3"; then
    lines+=("| $size^3 | left out: it does not fit the disk | - | - | - | - |")
    continue
  fi
  make_volume "$size"
  rm -f "$results"
  for run in $(seq "$runs"); do
    say "$size^3, run $run of $runs"
    warm "$raw"
    measure octavo "$work/out.octavo" "$octavo" convert "$raw" -o "$work/out.octavo" --json
    warm "$raw"
    measure roofline "$work/out.bricks" \
      "$target/release/roofline" "$raw" -o "$work/out.bricks" --lz4 tried --sync
  done
  lines+=("$(python3 - "$results" "$size" "${first:-0}" <<'PY'
import json, sys
from statistics import median
path, size, first = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
runs = {}
for line in map(json.loads, open(path)):
    runs.setdefault(line["label"], []).append(line)
seconds = {label: median(run["seconds"] for run in found) for label, found in runs.items()}
cost = {label: 1e9 * value / size**3 for label, value in seconds.items()}
memory = median(run["own_bytes"] for run in runs["octavo"]) / 1e6
print(f"| {size}^3 | {seconds['octavo']:.2f} | {cost['octavo']:.2f} "
      f"| {cost['octavo'] / (first or cost['octavo']):.2f} | {cost['roofline']:.2f} | {memory:.0f} |")
PY
  )")
  first=${first:-$(cut -d '|' -f 4 <<< "${lines[-1]}")}
  [[ ${KEEP:-} == 1 ]] || rm -f "$raw"
done

echo "Cost of a voxel, medians of $runs, $(nproc) cores; warm as far as memory holds the source"
provenance
echo
echo "| volume | octavo, s | octavo, ns a voxel | over the first | roofline on the disk, ns a voxel | octavo's own memory, MB |"
echo "|---|---|---|---|---|---|"
printf '%s\n' "${lines[@]}"
