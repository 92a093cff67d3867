#!/usr/bin/env bash
# Compressed sources against their decompression alone: bench/compressed.sh [SIZE]   [512]
#
# One .nii.gz, and stacks of TIFF slices packed by Deflate and by LZW, of the same volume. `decompress`
# unpacks with the libraries that the sources use and throws the bytes away; `octavo convert` makes a
# store. Where slices are unpacked by all cores, conversion cannot hide behind it: the least that both
# take is their processor time divided by the cores, and a stream's own time where that is more.
# BENCH_DIR, KEEP, OCTAVO, RUNS: see common.sh.
set -euo pipefail
source "$(dirname "$0")/common.sh"

size=${1:-512}
check_size "$size"
voxels=$((size * size * size))
needs_room $((12 * voxels)) "a volume of $size^3, packed in three ways," || exit 3
build
make_venv
make_volume "$size"
say "packing it"
"$venv/bin/python" "$here/peers/compressed_inputs.py" "$raw" "$size" "$work"
rm -f "$results"

inputs=("$work/p_$size.nii.gz" "$work/stack_deflate" "$work/stack_lzw")
for input in "${inputs[@]}"; do
  name=$(basename "$input")
  output="$work/out.octavo"
  can=1
  if ! "$octavo" convert "$input" -o "$output" --plan > "$work/plan.log" 2>&1; then
    say "octavo refuses $name: $(head -n 1 "$work/plan.log")"
    can=
  fi
  for run in $(seq "$runs"); do
    say "$name, run $run of $runs"
    if [[ -d $input ]]; then warm "$input"/*; else warm "$input"; fi
    for threads in 1 2; do
      # One stream of gzip is one thread's work.
      [[ $threads == 1 || -d $input ]] || continue
      measure "$name $threads" "$work/out.none" "$target/release/decompress" "$input" --threads "$threads"
    done
    warm "$raw"
    measure "$name plain" "$output" "$octavo" convert "$raw" -o "$output" --json
    if [[ -d $input ]]; then warm "$input"/*; else warm "$input"; fi
    if [[ $can ]]; then
      measure "$name convert" "$output" "$octavo" convert "$input" -o "$output" --json
    fi
  done
done

echo "Compressed sources of $size^3 u16, medians of $runs, $(nproc) cores, warm; seconds"
provenance
echo
python3 - "$results" "${inputs[@]}" <<'PY'
import json, os, sys
from statistics import median
runs = {}
for line in map(json.loads, open(sys.argv[1])):
    runs.setdefault(line["label"], []).append(line)
median_of = lambda label, what="seconds": median(r[what] for r in runs[label]) if label in runs else None
cpu_of = lambda label: median_of(label, "cpu_seconds")
show = lambda value: "-" if value is None else f"{value:.2f}"
print("| source | packed MB | decompression, 1 thread | 2 threads | octavo convert | over decompression (fewest seconds) | least for both | over that |")
print("|---|---|---|---|---|---|---|---|")
for name in map(os.path.basename, sys.argv[2:]):
    one, two, convert = (median_of(f"{name} {what}") for what in ("1", "2", "convert"))
    packed = runs[f"{name} 1"][0]["report"]["bytes_read"] / 1e6
    ratio = "refused by this octavo" if convert is None else f"{convert / min(one, two or one):.2f}"
    both = (cpu_of(f"{name} 1") + cpu_of(f"{name} plain")) / os.cpu_count()
    least = both if two else max(both, one)
    over = "-" if convert is None else f"{convert / least:.2f}"
    print(f"| {name} | {packed:.0f} | {show(one)} | {show(two)} | {show(convert)} | {ratio} | {show(least)} | {over} |")
PY
