#!/usr/bin/env bash
# What compressing the chunks of served zarr costs and gains: bench/compressors.sh [SIZE]   [256]
#
# A noisy micro-CT phantom of SIZE^3, the same quantised to eight bits, and the bundled tooth and bone, served with each --compressor. A row has
# the bytes over plain ones; microseconds that a request for a chunk takes that is not kept (one connection of wrk); kept chunks a second
# (16 connections); and what tensorstore takes to read level 0 through /zarr3. Medians of RUNS [3]. Needs wrk, and Python with tensorstore and
# zarr in OCTAVO_TEST_CLIENTS [target/clients, which tests/run.sh makes].
# BENCH_DIR, KEEP, OCTAVO, BUILD: see common.sh.
set -euo pipefail
source "$(dirname "$0")/common.sh"

size=${1:-256}
check_size "$size"
command -v wrk > /dev/null || fail "wrk is not installed: apt-get install wrk"
python=${OCTAVO_TEST_CLIENTS:-$target/clients/bin/python}
"$python" -c 'import tensorstore' || fail "$python has no tensorstore: tests/run.sh installs it"
needs_room $((8 * size * size * size)) "a volume of $size^3 and its stores" || exit 3
build
make_volume "$size"
stores="$work/packed"
mkdir -p "$stores"
convert() { "$octavo" convert "$1" -o "$stores/$2.octavo" --encoding "$3" --force --json > "$work/convert.log"; }
convert "$raw" phantom lossless
convert "$raw" phantom-u8 u8
convert "$here/../data-samples/tooth.nii.gz" tooth lossless
convert "$here/../data-samples/bone.nii.gz" bone lossless

cat > "$work/paths.lua" <<'LUA'
local paths, at = {}, 0
for line in io.lines(os.getenv("PATHS")) do paths[#paths + 1] = line end
request = function() at = at % #paths + 1; return wrk.format("GET", paths[at]) end
done = function(summary, latency)
  io.write(string.format("RESULT %.1f %.1f\n", summary.requests / summary.duration * 1e6, latency.mean))
end
LUA
export PATHS="$work/paths"
median() { sort -n | awk '{ all[NR] = $1 } END { print all[int((NR + 1) / 2)] }'; }
# load FIELD CONNECTIONS: chunks a second (2), or microseconds a request (3).
load() {
  for _ in $(seq "$runs"); do
    wrk -t 1 -c "$2" -d "${SECONDS_EACH:-2}s" -s "$work/paths.lua" "$base" | awk -v field="$1" '/^RESULT/ { print $field }'
  done | median
}
server=
end() { [[ -z $server ]] || kill "$server" 2> /dev/null || true; wait 2> /dev/null || true; tidy; }
trap end EXIT
# serve COMPRESSOR CACHE: sets `base`.
serve() {
  [[ -z $server ]] || { kill "$server"; wait "$server" 2> /dev/null || true; }
  : > "$work/address"
  "$octavo" serve "$stores" --bind 127.0.0.1:0 --compressor "$1" --cache "$2" > "$work/address" 2> "$work/server.log" &
  server=$!
  until [[ -s $work/address ]]; do sleep 0.1; done
  base=$(head -n 1 "$work/address")
  base=${base%/}
}

echo "Chunks of 32^3, loopback, medians of $runs, $(nproc) cores"
provenance
echo
echo "| volume | compressor | bytes / plain | us a chunk, not kept | kept chunks/s, 16 connections | tensorstore reads level 0, s |"
echo "|---|---|---|---|---|---|"
for dataset in phantom phantom-u8 tooth bone; do
  for compressor in none zstd blosc-lz4; do
    serve "$compressor" 0
    share=$(python3 "$here/peers/serve_load.py" packed "$base" "$dataset" "$PATHS")
    making=$(load 3 1)
    serve "$compressor" 256MiB
    load 2 16 > /dev/null
    kept=$(load 2 16)
    read=$("$python" "$here/peers/serve_load.py" read "$base" "$dataset" "$runs")
    echo "| $dataset | $compressor | $share | $making | $kept | $read |"
  done
done
