#!/usr/bin/env bash
# Conversion by Octavo and by others, of the same volume, in one run: bench/convert.sh [SIZE] [--zarrs]
#
# SIZE is the side of a cube of u16 noise and foam [1024]. Prints one table; progress goes to stderr.
# Every tool runs RUNS times [3], in turn; the source is warm. --zarrs adds zarrs_tools, which is
# installed first (minutes). BENCH_DIR, KEEP, OCTAVO: see common.sh.
#
# Octavo and the roofline count from the start of the process to its end, and the store is on the disk
# by then; Python peers count inside the process, without imports, and leave what they wrote to the
# system. Octavo and the roofline store 8 bits a voxel with an overlap (36^3 for 32^3), the others 16
# bits without.
set -euo pipefail
source "$(dirname "$0")/common.sh"

size=1024
with_zarrs=
for argument in "$@"; do
  case $argument in
    --zarrs) with_zarrs=1 ;;
    *) size=$argument ;;
  esac
done
check_size "$size"
voxels=$((size * size * size))
levels=0
while ((size >> levels > 32)); do levels=$((levels + 1)); done

needs_room $((6 * voxels)) "a volume of $size^3 and what is made of it" || exit 3
build
make_venv
has_openvisus=
if "$venv/bin/python" -m pip install --quiet --disable-pip-version-check OpenVisus==2.2.149 2> "$work/openvisus.log" &&
  "$venv/bin/python" -c 'import OpenVisus' > "$work/openvisus.log" 2>&1; then
  has_openvisus=1
fi
if [[ $with_zarrs ]]; then
  say "installing zarrs_tools"
  cargo install zarrs_tools --version 0.8.1 --locked --quiet --features ome \
    --root "$target/zarrs-tools" 2> "$work/zarrs.log" || with_zarrs=failed
fi
make_volume "$size"
rm -f "$results"

efforts=()
if "$octavo" convert --help | grep -q -e '--effort'; then
  usual=$("$octavo" convert --help | sed -n '/--effort/,$s/.*\[default: \([a-z]*\)\].*/\1/p' | head -n 1)
  for effort in fast balanced small; do
    [[ $effort == "$usual" ]] || efforts+=("$effort")
  done
fi

if [[ $with_zarrs == 1 ]]; then
  say "making the array that zarrs_ome reads"
  "$venv/bin/python" "$here/peers/tensorstore_convert.py" "$raw" "$size" "$work/out.array" 0 > "$work/array.log"
fi

for run in $(seq "$runs"); do
  say "run $run of $runs"
  warm "$raw"
  measure "octavo" "$work/out.octavo" "$octavo" convert "$raw" -o "$work/out.octavo" --json
  for effort in ${efforts[@]+"${efforts[@]}"}; do
    measure "octavo --effort $effort" "$work/out.octavo" \
      "$octavo" convert "$raw" -o "$work/out.octavo" --effort "$effort" --json
  done
  measure "octavo --encoding lossless" "$work/out.octavo" \
    "$octavo" convert "$raw" -o "$work/out.octavo" --encoding lossless --json
  measure "roofline, whole LZ4" "$work/out.bricks" \
    "$target/release/roofline" "$raw" -o "$work/out.bricks"
  measure "roofline, LZ4 where it gains" "$work/out.bricks" \
    "$target/release/roofline" "$raw" -o "$work/out.bricks" --lz4 tried
  measure "the same, on the disk" "$work/out.bricks" \
    "$target/release/roofline" "$raw" -o "$work/out.bricks" --lz4 tried --sync
  warm "$raw"
  measure "tensorstore, zarr3 in shards" "$work/out.zarr" \
    "$venv/bin/python" "$here/peers/tensorstore_convert.py" "$raw" "$size" "$work/out.zarr" "$levels"
  if [[ $has_openvisus ]]; then
    measure "OpenVisus (subsamples, not compressed)" "$work/out.idx" \
      "$venv/bin/python" "$here/peers/openvisus_convert.py" "$raw" "$size" "$work/out.idx"
  fi
  if [[ $with_zarrs == 1 ]]; then
    warm -- "$work"/out.array/0/c/*/*/*
    measure "zarrs_ome (from zarr3, importing not counted)" "$work/out.zarr" \
      "$target/zarrs-tools/bin/zarrs_ome" --max-levels "$levels" "$work/out.array/0" "$work/out.zarr"
  fi
done
[[ $has_openvisus ]] || remark "OpenVisus" "the package cannot be had here"
[[ $with_zarrs != failed ]] || remark "zarrs_tools" "could not be installed"

echo "Conversion of $size^3 u16, medians of $runs, $(nproc) cores, warm"
provenance
echo
python3 "$here/peers/table.py" "$results" "$voxels" octavo
python3 - "$results" <<'PY'
# The roofline's bricks are the store's own: as many, and as many bytes where it tries LZ4 alike.
import json, sys
reports = {}
for line in map(json.loads, open(sys.argv[1])):
    reports.setdefault(line["label"], line.get("report", {}))
store, roofline = reports["octavo"], reports["roofline, LZ4 where it gains"]
bricks = sum(level["stored"] + level["uniform"] + level["empty"] for level in store["levels"])
same = [bricks, store["payload_bytes"]] == [roofline["bricks"], roofline["bytes_written"]]
print(f"\nBricks: octavo {bricks} of {store['payload_bytes']} bytes, roofline {roofline['bricks']} of "
      f"{roofline['bytes_written']}: {'the same' if same else 'NOT the same'}")
PY
