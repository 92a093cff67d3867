#!/usr/bin/env bash
# Enlarging by Octavo and by others, of the same volume: bench/upscale.sh [PART...]
#
# Parts, all but the last if none is named:
#   rate      256^3 to 1024^3 without a disk, tricubic alone and with detail, beside the arithmetic roofline
#   peers     256^3 to 512^3 by scipy.ndimage.zoom, by ITK, and by Octavo, and how far the results lie apart;
#             minutes, nearly all of them scipy's
#   spectrum  the power spectrum of 64^3, enlarged to 256^3, without and with detail
#   store     256^3 converted to a store of 1024^3, against converting the same 1024^3 from the disk
#   big       512^3 converted to a store of 2048^3 once, with --empty-below 6400: minutes, up to 15 GB
#
# Progress goes to stderr. BENCH_DIR, KEEP, OCTAVO, RUNS: see common.sh.
set -euo pipefail
source "$(dirname "$0")/common.sh"

parts=("$@")
((${#parts[@]})) || parts=(rate peers spectrum store)
for part in "${parts[@]}"; do
  [[ $part =~ ^(rate|peers|spectrum|store|big)$ ]] || fail "no part is called '$part'"
done
[[ ${BUILT:-} == 1 ]] || build
octavo="$work/octavo" phantom="$target/release/phantom" enlarge="$target/release/enlarge"
[[ -x $octavo ]] || cp "${OCTAVO:-$target/release/octavo}" "$octavo"

# median FIELD LABEL: of the runs in $results.
median() {
  python3 - "$results" "$1" "$2" <<'PY'
import json, sys
from statistics import median
path, field, label = sys.argv[1:]
runs = [line for line in map(json.loads, open(path)) if line["label"] == label]
print(median(line["report"].get(field, line.get(field)) for line in runs))
PY
}

rate() {
  make_volume 256
  warm "$raw"
  rm -f "$results"
  for run in $(seq "$runs"); do
    say "rate, run $run of $runs"
    measure "tricubic" "" "$enlarge" "$raw"
    measure "with detail" "" "$enlarge" "$raw" --detail 0.5
  done
  echo "Enlarging 256^3 u16 four times, medians of $runs, 2 threads, no disk"
  provenance
  echo
  echo "| what | million new voxels a second | arithmetic roofline |"
  echo "|---|---|---|"
  for what in "tricubic" "with detail"; do
    echo "| $what | $(median million_voxels_per_sec "$what") |" \
      "$(median roofline_million_voxels_per_sec "$what") |"
  done
  echo
}

peers() {
  make_venv requirements-upscale.txt
  make_volume 256
  warm "$raw"
  rm -f "$results"
  local scipy="$work/scipy_512x512x512_u16.raw" itk="$work/itk_512x512x512_u16.raw"
  for run in $(seq "$runs"); do
    say "peers, run $run of $runs"
    measure octavo "" "$enlarge" "$raw" --factor 2 --kernel b-spline
    measure itk "" "$venv/bin/python" "$here/peers/simpleitk_resample.py" "$raw" 256 2 "$itk"
    measure scipy "" "$venv/bin/python" "$here/peers/scipy_zoom.py" "$raw" 256 2 "$scipy"
  done
  echo "Enlarging 256^3 u16 twice by a cubic B-spline, medians of $runs, 2 cores"
  provenance
  echo
  python3 "$here/peers/table.py" "$results" $((512 * 512 * 512)) octavo
  echo
  local kernel ours="$work/ours_512x512x512_u16.raw"
  for kernel in b-spline catmull-rom; do
    "$octavo" upscale "$raw" -o "$ours" --factor 2 --kernel "$kernel" --force > "$work/upscale.log"
    for peer in "$scipy" "$itk"; do
      echo "$(basename "${peer%%_*}") against octavo's $kernel:"
      "$octavo" compare "$peer" "$ours"
    done
  done
  rm -f "$scipy" "$itk" "$ours"
  echo
}

spectrum() {
  make_venv requirements-upscale.txt
  make_volume 64
  local plain="$work/plain.raw" detailed="$work/detailed.raw"
  "$octavo" upscale "$raw" -o "$plain" --force > "$work/upscale.log"
  "$octavo" upscale "$raw" -o "$detailed" --detail 0.5 --seed 1 --force > "$work/upscale.log"
  echo "Power by frequency, dB over the source's lowest row; 64^3 enlarged four times, detail 0.5"
  echo
  "$venv/bin/python" "$here/peers/spectrum.py" "$raw" "$plain" "$detailed" 64 4
  rm -f "$plain" "$detailed"
  echo
}

store() {
  needs_room $((6 * 1024 * 1024 * 1024)) "a volume of 1024^3 and its store" || exit 3
  make_volume 256
  local small="$raw" large="$work/large_1024x1024x1024_u16.raw"
  "$octavo" upscale "$small" -o "$large" --force > "$work/upscale.log"
  warm "$small" "$large"
  rm -f "$results"
  for run in $(seq "$runs"); do
    say "store, run $run of $runs"
    measure "from the disk" "$work/out.octavo" "$octavo" convert "$large" -o "$work/out.octavo" --json
    measure "enlarged on the way" "$work/out.octavo" "$octavo" convert "$small" -o "$work/out.octavo" --upscale 4 --json
    measure "with detail" "$work/out.octavo" "$octavo" convert "$small" -o "$work/out.octavo" --upscale 4 --detail 0.5 --json
  done
  rm -f "$large"
  echo "Stores of 1024^3, medians of $runs, 2 cores, warm"
  provenance
  echo
  python3 "$here/peers/table.py" "$results" $((1024 * 1024 * 1024)) "from the disk"
  echo
}

big() {
  needs_room 18000000000 "a store of 2048^3" || exit 3
  make_volume 512
  warm "$raw"
  rm -f "$results"
  local out="$work/out.octavo"
  local flags=(--upscale 4 --detail 0.5 --seed 1 --empty-below 6400)
  "$octavo" convert "$raw" -o "$out" --force "${flags[@]}" --plan
  say "big"
  measure big "$out" "$octavo" convert "$raw" -o "$out" "${flags[@]}" --json
  echo
  echo "512^3 u16 enlarged to a store of 2048^3, one run, 2 cores"
  provenance
  echo
  python3 "$here/peers/beside_2010.py" "$results"
}

for part in "${parts[@]}"; do "$part"; done
