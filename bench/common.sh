# Sourced by the scripts beside it: where things lie, what is built, how one run is measured.
#
# BENCH_DIR  where the work folder octavo-bench is made, on the disk that is to be measured [target]
# KEEP=1     leave the work folder; volumes in it are used again
# OCTAVO     the program to measure; built from this checkout if not given
# BUILD=0    build nothing: what lies in target/release counts
# RUNS       runs of each tool, of which the median counts [3]
# shellcheck shell=bash

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
OCTAVO=${OCTAVO:+$(realpath "$OCTAVO")}
target=$(realpath -m "${CARGO_TARGET_DIR:-$here/../target}")
work=$(realpath -m "${BENCH_DIR:-$target}")/octavo-bench
cd "$here/.."
venv="$target/bench-venv"
runs=${RUNS:-3}
mkdir -p "$work"
results="$work/results.jsonl"

say() { echo "$*" >&2; }
fail() { say "$(basename "$0"): $*"; exit 2; }

# Volumes of a size that the peers' scripts can halve down to one brick.
check_size() {
  [[ $1 =~ ^[0-9]+$ ]] && (($1 >= 32 && ($1 & ($1 - 1)) == 0)) ||
    fail "a size is a power of two from 32 up, as in 512; found '$1'"
}

build() {
  [[ ${BUILD:-1} == 0 ]] || say "building"
  local packages=(-p bench -p data-samples)
  [[ -n ${OCTAVO:-} ]] || packages+=(-p octavo)
  [[ ${BUILD:-1} == 0 ]] || cargo build --release --locked --quiet "${packages[@]}"
  octavo=${OCTAVO:-$target/release/octavo}
  phantom="$target/release/phantom"
  [[ -x $octavo ]] || fail "$octavo cannot be run"
  # A copy, so that a build meanwhile cannot change the program between two runs.
  cp "$octavo" "$work/octavo"
  octavo="$work/octavo"
}

# Which program was measured, and how busy the machine was: a table without them proves little.
provenance() {
  echo "octavo: $("$octavo" --version), sha256 $(sha256sum < "$octavo" | cut -c 1-12); load" \
    "$load_before before, $(cut -d ' ' -f 1 /proc/loadavg) after, of $(nproc) cores"
}
load_before=$(cut -d ' ' -f 1 /proc/loadavg)

# Python packages of the peers, into a folder of their own: make_venv [LIST=requirements.txt]
make_venv() {
  [[ -x $venv/bin/python ]] || python3 -m venv "$venv"
  "$venv/bin/python" -m pip install --quiet --disable-pip-version-check -r "$here/peers/${1:-requirements.txt}"
}

# needs_room BYTES WHAT
needs_room() {
  local free
  free=$(df --output=avail -B1 "$work" | tail -n 1)
  ((free >= $1)) && return
  say "$2 needs $(($1 / 1000000000)) GB in $work, and $((free / 1000000000)) GB are free"
  return 1
}

# make_volume SIZE: sets `raw`.
make_volume() {
  raw="$work/p_$1x$1x$1_u16.raw"
  local bytes=$((2 * $1 * $1 * $1))
  [[ -f $raw && $(stat -c %s "$raw") == "$bytes" ]] && return
  say "making a volume of $1^3"
  "$phantom" micro-ct --dims "$1,$1,$1" -o "$raw" > "$work/phantom.log"
}

# warm FILE...: into the page cache; what was written before, onto the disk.
warm() {
  sync -f "$work"
  cat "$@" > /dev/null
}

# measure LABEL OUTPUT PROGRAM [ARGUMENTS]: one line in $results; the output is removed before and after.
measure() {
  local label=$1 output=$2
  shift 2
  rm -rf "$output"
  sync -f "$work"
  python3 "$here/peers/measure.py" "$label" --results "$results" --output "$output" -- "$@"
  rm -rf "$output"
}

# remark LABEL TEXT: a row that says why there are no figures.
remark() {
  python3 -c 'import json, sys; print(json.dumps({"label": sys.argv[1], "remark": sys.argv[2]}))' \
    "$1" "$2" >> "$results"
}

tidy() {
  [[ ${KEEP:-} == 1 ]] || rm -rf "$work"
}
trap tidy EXIT
