#!/usr/bin/env bash
# Random reads from a store and, by the crate zarrs, from a sharded zarr3 array: bench/reads.sh [SIZE]   [512]
#
# The same volume, the same places in the same order, 1 and 2 threads, warm. zarrs reads 32^3 sub-chunks
# of 16 bits (blosc-lz4, shards of 256^3, written by tensorstore); Octavo bricks of 36^3, once of 8
# bits and once lossless, decoded to 16 bits, every payload checked against its checksum. Each program
# takes the median of five rounds; the programs take turns RUNS times [3] and the median counts.
# BENCH_DIR, KEEP, OCTAVO: see common.sh; OCTAVO must write the format that this checkout's random_reads
# reads.
set -euo pipefail
source "$(dirname "$0")/common.sh"

size=${1:-512}
check_size "$size"
((size >= 64)) || fail "$size^3 is one brick: take 64 or more"
voxels=$((size * size * size))
needs_room $((8 * voxels)) "a volume of $size^3 and three stores of it" || exit 3
build
say "building zarrs-reads"
CARGO_TARGET_DIR="$target/zarrs-reads" \
  cargo build --release --locked --quiet --manifest-path "$here/zarrs-reads/Cargo.toml"
make_venv
make_volume "$size"
say "making the stores"
"$octavo" convert "$raw" -o "$work/out.u8.octavo" --force --json > "$work/convert.log"
"$octavo" convert "$raw" -o "$work/out.lossless.octavo" --encoding lossless --force --json > "$work/convert.log"
"$venv/bin/python" "$here/peers/tensorstore_convert.py" "$raw" "$size" "$work/out.zarr" 0 > "$work/convert.log"
sync -f "$work"

rate() { awk '{ print $3 }'; }
median() { sort -n | awk '{ all[NR] = $1 } END { print all[int((NR + 1) / 2)] }'; }
random_reads="$target/release/random_reads"
zarrs_reads="$target/zarrs-reads/release/zarrs-reads"

"$random_reads" "$work/out.u8.octavo" --reads 1 --rounds 1 > "$work/convert.log" 2>&1 ||
  fail "this checkout's random_reads cannot read what $("$octavo" --version) wrote: $(head -n 1 "$work/convert.log")"

echo "Random reads a second of $size^3 u16, medians, $(nproc) cores, warm"
provenance
echo
echo "| threads | octavo, 8 bits | octavo, lossless | zarrs | 8 bits over zarrs (wanted 1.5) | lossless over zarrs |"
echo "|---|---|---|---|---|---|"
for threads in 1 2; do
  eights='' exacts='' zarrs=''
  for run in $(seq "$runs"); do
    say "$threads threads, run $run of $runs"
    eights+=$("$random_reads" "$work/out.u8.octavo" --threads "$threads" | rate)$'\n'
    zarrs+=$("$zarrs_reads" "$work/out.zarr/0" --threads "$threads" | rate)$'\n'
    exacts+=$("$random_reads" "$work/out.lossless.octavo" --threads "$threads" | rate)$'\n'
  done
  printf '%s' "$eights" | median > "$work/eight.log"
  printf '%s' "$exacts" | median > "$work/exact.log"
  printf '%s' "$zarrs" | median > "$work/zarrs.log"
  paste "$work/eight.log" "$work/exact.log" "$work/zarrs.log" |
    awk -v t="$threads" '{ printf "| %d | %d | %d | %d | %.2f | %.2f |\n", t, $1, $2, $3, $1 / $3, $2 / $3 }'
done
