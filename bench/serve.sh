#!/usr/bin/env bash
# The server beside nginx: bench/serve.sh [SIZE]   [256]
#
# Chunks of 32^3 voxels of u16 (64 KiB) over the loopback, warm, at equal connections: the server makes them of a store, nginx sends the
# same bytes as files. wrk asks for all level-0 chunks in turn; the two take turns RUNS times [3], SECONDS_EACH seconds each [5], and medians count. Then the
# memory with 1,000 idle and 256 busy connections, and a cut for 1024 x 576 at one voxel a pixel. Needs nginx and wrk (apt-get install nginx-light wrk).
# BENCH_DIR, KEEP, OCTAVO: see common.sh. SERVER: a program that serves the folder it is given and prints its address, instead of `octavo serve`.
set -euo pipefail
source "$(dirname "$0")/common.sh"

size=${1:-256}
check_size "$size"
for tool in nginx wrk; do command -v $tool > /dev/null || fail "$tool is not installed: apt-get install nginx-light wrk"; done
needs_room $((8 * size * size * size)) "a volume of $size^3, its store and its chunks" || exit 3
build
make_volume "$size"
store="$work/stores/bench.octavo"
mkdir -p "$work/stores"
"$octavo" convert "$raw" -o "$store" --encoding lossless --spacing 1,1,1 --force --json > "$work/convert.log"

pids=()
end() { kill "${pids[@]}" 2> /dev/null || true; wait 2> /dev/null || true; tidy; }
trap end EXIT
if [[ -n ${SERVER:-} ]]; then
  "$SERVER" "$work/stores" > "$work/address" 2> "$work/server.log" &
else
  "$octavo" serve "$work/stores" --bind 127.0.0.1:0 > "$work/address" 2> "$work/server.log" &
fi
server=$!
pids+=("$server")
until [[ -s $work/address ]]; do sleep 0.1; done
base=$(head -n 1 "$work/address")
base=${base%/}

python3 "$here/peers/serve_load.py" chunks "$base" bench "$work/static"
cat > "$work/nginx.conf" <<CONF
worker_processes auto; daemon off; pid $work/nginx.pid; error_log $work/nginx.log;
events { worker_connections 2048; }
http { access_log off; sendfile on; keepalive_requests 1000000000; default_type application/octet-stream; open_file_cache max=100000;
  server { listen 127.0.0.1:8643; root $work/static; } }
CONF
nginx -c "$work/nginx.conf" -p "$work" 2> "$work/nginx.log" &
pids+=("$!")
sleep 1
cat > "$work/paths.lua" <<'LUA'
local paths, at = {}, 0
for line in io.lines(os.getenv("PATHS")) do paths[#paths + 1] = line end
request = function() at = at % #paths + 1; return wrk.format("GET", paths[at]) end
done = function(summary, latency)
  io.write(string.format("RESULT %.1f %.3f %.3f %d\n", summary.requests / summary.duration * 1e6, latency:percentile(50) / 1e3,
    latency:percentile(99) / 1e3, summary.errors.status + summary.errors.connect + summary.errors.read + summary.errors.timeout))
end
LUA
export PATHS="$work/static/paths"
load() { wrk -t 1 -c "$2" -d "${SECONDS_EACH:-5}s" -s "$work/paths.lua" "$1" | awk '/^RESULT/ { print $2, $3, $4, $5 }'; }
median() { sort -n | awk '{ all[NR] = $1 } END { print all[int((NR + 1) / 2)] }'; }
load "$base" 16 > /dev/null
load http://127.0.0.1:8643 16 > /dev/null

echo "Chunks of 32^3 u16 a second of $size^3, wrk, loopback, medians of $runs, $(nproc) cores, warm"
provenance
echo
echo "| connections | octavo /s | nginx /s | ratio | octavo p50 ms | p99 ms | p99/p50 | nginx p50 ms | p99 ms | p99/p50 | errors, octavo + nginx |"
echo "|---|---|---|---|---|---|---|---|---|---|---|"
for connections in 1 16 64; do
  : > "$work/a"; : > "$work/b"
  for _ in $(seq "$runs"); do
    load "$base" "$connections" >> "$work/a"
    load http://127.0.0.1:8643 "$connections" >> "$work/b"
  done
  a=$(cut -d ' ' -f 1 "$work/a" | median); b=$(cut -d ' ' -f 1 "$work/b" | median)
  p50=$(cut -d ' ' -f 2 "$work/a" | median); p99=$(cut -d ' ' -f 3 "$work/a" | median)
  n50=$(cut -d ' ' -f 2 "$work/b" | median); n99=$(cut -d ' ' -f 3 "$work/b" | median)
  errors="$(awk '{ n += $4 } END { print n }' "$work/a") + $(awk '{ n += $4 } END { print n }' "$work/b")"
  awk -v c="$connections" -v a="$a" -v b="$b" -v p="$p50" -v q="$p99" -v n="$n50" -v m="$n99" -v e="$errors" \
    'BEGIN { printf "| %d | %.0f | %.0f | %.2f | %.3f | %.3f | %.1f | %.3f | %.3f | %.1f | %s |\n", c, a, b, a / b, p, q, q / p, n, m, m / n, e }'
done
echo
python3 "$here/peers/serve_load.py" connections "$base" bench "$server" "$work/paths.lua"
python3 "$here/peers/serve_load.py" cut "$base" bench "$size"
