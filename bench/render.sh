#!/usr/bin/env bash
# Pictures: bench/render.sh [SIZE] [LARGEST]   [512 2048]
#
# 1024 x 576 pixels of u16 phantoms, unshaded, levels not blended, samples one voxel apart where nothing else is said. First SIZE^3 beside VTK's mappers on the same
# view, in turn, RUNS times [3], medians; VTK holds the volume in memory, Octavo reads its store. Then the time of a frame as the volume grows to LARGEST^3, its side
# covering 256 pixels, so that a voxel of the level at hand covers one whatever the size, and 512. Then what accuracy and step
# cost and save. ADAPTER: a part of the graphics adapter's name. BENCH_DIR, KEEP, OCTAVO: see common.sh.
set -euo pipefail
source "$(dirname "$0")/common.sh"

size=${1:-512}
largest=${2:-2048}
check_size "$size"
check_size "$largest"
build
make_venv requirements-render.txt
python="$venv/bin/python"
export XDG_RUNTIME_DIR=${XDG_RUNTIME_DIR:-/tmp}
adapter=(${ADAPTER:+--adapter "$ADAPTER"})

median() { sort -g | awk '{ all[NR] = $1 } END { print all[int((NR + 1) / 2)] }'; }
field() { "$python" -c 'import json, sys; print(json.load(sys.stdin)[sys.argv[1]])' "$1"; }

# store_of SIZE ENCODING: sets `store`.
store_of() {
  store="$work/p_$1_$2.octavo"
  [[ -f $store ]] && return
  needs_room $((5 * $1 * $1 * $1)) "a volume of $1^3 and its store" || exit 3
  make_volume "$1"
  "$octavo" convert "$raw" -o "$store" --encoding "$2" --spacing 1,1,1 --force --json > "$work/convert.log"
}

# draw STORE KIND SIDE PIXELS STEP [FLAGS]: JSON of what drawing took; the picture is $work/picture.png.
draw() {
  local drawn=$1 kind=$2 side=$3 pixels=$4 step=$5
  shift 5
  "$python" "$here/peers/scene.py" "$side" "$kind" "$work" "$pixels"
  "$octavo" render "$drawn" -o "$work/picture.png" --size 1024x576 --camera "$work/camera.json" --transfer "$work/transfer.json" \
    --shading off --filter trilinear --step "$step" "${adapter[@]}" "$@" --force --json 2> "$work/render.log"
}

store_of "$size" u8
beside="$store"
make_volume "$size"
echo "Seconds of a converged frame of $size^3, 1024 x 576, medians of $runs"
provenance
echo "adapter: $(draw "$beside" opaque "$size" 521 1 | field adapter)"
echo
echo "| transfer function | octavo, texture units | octavo, exact | VTK GPU mapper | VTK fixed point | octavo over the faster of VTK's |"
echo "|---|---|---|---|---|---|"
for kind in opaque transparent; do
  : > "$work/hardware"; : > "$work/manual"; : > "$work/gpu"; : > "$work/fixed"
  for _ in $(seq "$runs"); do
    for sampling in hardware manual; do draw "$beside" $kind "$size" 521 1 --sampling $sampling | field frame_ms >> "$work/$sampling"; done
    "$python" "$here/peers/scene.py" "$size" $kind "$work"
    for mapper in gpu fixed; do
      "$python" "$here/peers/render.py" "$raw" "$size" $mapper "$work/scene.json" 3 2> "$work/vtk.log" | field median_secs >> "$work/$mapper"
    done
  done
  awk -v k=$kind -v h="$(median < "$work/hardware")" -v m="$(median < "$work/manual")" -v g="$(median < "$work/gpu")" -v f="$(median < "$work/fixed")" \
    'BEGIN { b = g < f ? g : f; printf "| %s | %.2f | %.2f | %.2f | %.2f | %.2f |\n", k, h / 1e3, m / 1e3, g, f, h / 1e3 / b }'
done

echo
echo "Milliseconds of a converged frame as the volume grows, medians of $runs"
echo
echo "| volume | 256 pixels, opaque | transparent | bricks shown | 512 pixels, opaque | transparent | bricks shown |"
echo "|---|---|---|---|---|---|---|"
for ((side = 256; side <= largest; side *= 2)); do
  store_of "$side" u8
  [[ $side == "$size" ]] || rm -f "$work/p_${side}x${side}x${side}_u16.raw"
  row="| $side^3 |"
  for pixels in 256 512; do
    for kind in opaque transparent; do
      : > "$work/times"
      for _ in $(seq "$runs"); do draw "$store" $kind "$side" $pixels 1 > "$work/drawn"; field frame_ms < "$work/drawn" >> "$work/times"; done
      row+=" $(median < "$work/times" | awk '{ printf "%.0f", $1 }') |"
    done
    row+=" $(field bricks_in_cut < "$work/drawn") |"
  done
  echo "$row"
  [[ $side == "$size" ]] || rm -f "$store"
done

# The truth: all of level 0, exact samples, an eighth of a voxel apart, from a store that lost nothing.
store_of "$size" lossless
echo
echo "What accuracy and step cost, $size^3: PSNR against level 0 with samples an eighth of a voxel apart, of a lossless store; the store drawn is the default, 8 bits"
for kind in opaque transparent; do
  draw "$store" $kind "$size" 521 0.125 --accuracy 0.05 --sampling manual --slots 40000 > "$work/drawn"
  cp "$work/picture.png" "$work/truth.png"
  echo
  echo "| $kind: pixels a voxel | step, voxels | frame ms | bricks read | MB read | PSNR dB |"
  echo "|---|---|---|---|---|---|"
  for accuracy in 0.5 1 2 4; do
    for step in 0.25 0.5 1 2; do
      draw "$beside" $kind "$size" 521 $step --accuracy $accuracy --slots 40000 > "$work/drawn"
      psnr=$("$python" "$here/peers/psnr.py" "$work/picture.png" "$work/truth.png")
      echo "| $accuracy | $step | $(field frame_ms < "$work/drawn" | awk '{ printf "%.0f", $1 }') | $(field bricks_loaded < "$work/drawn") | $(field bytes_read < "$work/drawn" | awk '{ printf "%.1f", $1 / 1e6 }') | $psnr |"
    done
  done
done
