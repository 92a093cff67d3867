#!/usr/bin/env bash
# Octavo beside zfp, SZ3 and blosc2 at equal largest error: bench/accuracy.sh [NAME_XxYxZ_u16.raw:E]...
#
# Without volumes: the middle 256^3 of the micro-CT phantom of 512^3 (E = 50), and the bundled tooth (E = 5). One thread,
# warm, medians of RUNS [3]; a table a volume. Bits a voxel are of level 0 alone, without records: the peers have no
# pyramid. Octavo's encoding is the whole conversion, from a raw file to a durable store with its pyramid, checksums and
# error statistics; the peers' is from memory to memory. Octavo's decoding is of level 0's cores, from the store, with
# checksums; a region is 32^3 voxels at a random place, which lies in up to eight bricks.
# BENCH_DIR, KEEP, OCTAVO: see common.sh; OCTAVO must write the format that this checkout's random_reads reads.
set -euo pipefail
source "$(dirname "$0")/common.sh"

volumes=("$@")
for volume in "${volumes[@]}"; do
  [[ $volume =~ _([0-9]+)x([0-9]+)x([0-9]+)_u16\.raw:[0-9.]+$ && -f ${volume%:*} ]] ||
    fail "a volume is a raw file and a largest error, as in scan_320x320x128_u16.raw:20; found '$volume'"
done
needs_room 2000000000 "three volumes and stores of them" || exit 3
build
make_venv
if ((${#volumes[@]} == 0)); then
  make_volume 512
  say "cutting the middle out of it"
  crop="$work/middle_256x256x256_u16.raw"
  "$octavo" convert "$raw" -o "$work/cut.octavo" --roi 128:384,128:384,128:384 --encoding lossless --force --json > "$work/convert.log"
  "$octavo" extract "$work/cut.octavo" -o "$crop" --force > "$work/convert.log"
  tooth="$work/tooth_103x94x161_u16.raw"
  "$octavo" convert data-samples/tooth.nii.gz -o "$work/cut.octavo" --encoding lossless --force --json > "$work/convert.log"
  "$octavo" extract "$work/cut.octavo" -o "$tooth" --force > "$work/convert.log"
  volumes=("$crop:50" "$tooth:5")
fi

for volume in "${volumes[@]}"; do
  file=${volume%:*} bound=${volume##*:}
  [[ $file =~ _([0-9]+)x([0-9]+)x([0-9]+)_u16\.raw$ ]]
  dims="${BASH_REMATCH[1]},${BASH_REMATCH[2]},${BASH_REMATCH[3]}"
  warm "$file"
  say "$(basename "$file"): octavo"
  report="$work/accuracy"
  "$octavo" tradeoff "$file" -o "$report" --force --threads 1 --max-error "$bound" --sample 1000000000 --json > "$work/convert.log"
  : > "$work/regions.tsv"
  python3 - "$report/report.json" > "$work/rungs.tsv" <<'PY'
import json, sys
for rung in json.load(open(sys.argv[1]))["rungs"]:
    if rung["empty_below"] is None:
        print(rung["name"] + "\t" + " ".join(rung["arguments"]))
PY
  while IFS=$'\t' read -r name arguments; do
    # shellcheck disable=SC2086
    "$octavo" convert "$file" -o "$work/region.octavo" --force --json $arguments > "$work/convert.log"
    rate=$("$target/release/random_reads" "$work/region.octavo" --region 32 --reads 100 --rounds "$runs" | awk '{ print $3 }')
    awk -v rate="$rate" -v name="$name" 'BEGIN { printf "%.1f\t%s\n", 1e6 / rate, name }' >> "$work/regions.tsv"
  done < "$work/rungs.tsv"
  say "$(basename "$file"): peers"
  "$venv/bin/python" "$here/peers/accuracy.py" "$file" "$dims" "$bound" "$runs" > "$work/peers.jsonl"
  echo "$(basename "$file"), largest error $bound, one thread, medians of $runs"
  provenance
  echo
  python3 "$here/peers/accuracy_table.py" "$report/report.json" "$work/regions.tsv" "$work/peers.jsonl"
  echo
done
