#!/usr/bin/env bash
# The tests that take long: laws on many more cases, a volume of 2.1 GB, and its memory.
set -euo pipefail
cd "$(dirname "$0")/.."
PROPTEST_CASES=2000 cargo nextest run --workspace -E 'kind(lib)'
PROPTEST_CASES=200 cargo nextest run -p preprocess -E 'binary(laws)'

# The laws of every kernel, on processors with AVX2 alone and without it.
for cpu in Haswell Nehalem; do
  for package in octree-store preprocess; do
    CARGO_TARGET_X86_64_UNKNOWN_LINUX_GNU_RUNNER="qemu-x86_64 -cpu $cpu" \
      cargo test -p "$package" --lib -- encoding downsample value_stats error_sum
  done
done

# Faults at every operation, five times with other power cuts and second stops; a thousand flipped bits in each kind of bytes.
OCTAVO_TEST_ROUNDS=5 cargo nextest run --workspace --no-capture -E 'package(preprocess) and binary(crash)'
OCTAVO_TEST_FLIPS=1000 cargo nextest run --workspace --no-capture -E 'package(octree-store) and binary(damage)'

# libFuzzer, a minute a parser, where cargo-fuzz is (cargo install cargo-fuzz).
if cargo fuzz --version >/dev/null 2>&1; then fuzz/run.sh 60; fi

# Fifty kills of the program at random moments, each gone on with.
OCTAVO_TEST_KILLS=50 cargo nextest run -p octavo -E 'test(a_killed_conversion)'

cargo build --release --workspace
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
octavo="$PWD/target/release/octavo"

# Fifty more of a release build on a gigabyte, with what each cost; two hundred on an eighth of it, and disks that are too small.
target/release/phantom micro-ct --dims 1024,1024,512 -o "$work/g_1024x1024x512_u16.raw"
python3 tests/kills.py "$octavo" "$work/g_1024x1024x512_u16.raw" 50
rm "$work/g_1024x1024x512_u16.raw"
target/release/phantom micro-ct --dims 512,512,256 -o "$work/s_512x512x256_u16.raw"
python3 tests/kills.py "$octavo" "$work/s_512x512x256_u16.raw" 200
if [ "$(id -u)" = 0 ]; then python3 tests/full_disk.py "$octavo" "$work/s_512x512x256_u16.raw" 40; fi
rm "$work/s_512x512x256_u16.raw"

# An hour of serving under mixed load, with stores replaced.
mkdir "$work/hour"
"${OCTAVO_TEST_CLIENTS:-target/clients/bin/python}" tests/serve_hours.py "$octavo" "$work/hour" "${OCTAVO_TEST_SERVE_SECONDS:-3600}"

# More than TIFF can hold: BigTIFF, of a sparse volume of zeros.
truncate -s $((2048 * 2048 * 1040)) "$work/z_2048x2048x1040_u8.raw"
"$octavo" convert "$work/z_2048x2048x1040_u8.raw" -o "$work/z.octavo"
"$octavo" extract "$work/z.octavo" -o "$work/z.tif"
"$octavo" compare "$work/z.tif" "$work/z_2048x2048x1040_u8.raw" --max-amax 0
[ "$(head -c 4 "$work/z.tif" | xxd -p)" = 49492b00 ]
rm "$work"/z*

target/release/phantom micro-ct --dims 1024,1024,1024 -o "$work/p_1024x1024x1024_u16.raw"
for threads in 1 2 7; do
  "$octavo" convert "$work/p_1024x1024x1024_u16.raw" -o "$work/p.octavo" --force \
    --threads "$threads" --json > "$work/$threads.json"
done
"$octavo" verify "$work/p.octavo" --against "$work/p_1024x1024x1024_u16.raw"
python3 - "$work" <<'PY'
import json, sys
reports = [json.load(open(f"{sys.argv[1]}/{t}.json")) for t in (1, 2, 7)]
assert len({r["digest"] for r in reports}) == 1, [r["digest"] for r in reports]
for r in reports:
    print(r["threads"], "threads:", r["voxels_per_sec"] / 1e6, "million voxels/s,",
          r["peak_memory_bytes"] / 1e6, "MB own memory,", r["file_bytes"] / r["payload_bytes"], "file over payload")
    assert r["peak_memory_bytes"] <= 600e6 and r["file_bytes"] <= 1.02 * r["payload_bytes"]
print("3 passed, 0 failed")
PY
