#!/usr/bin/env bash
# Fuzzes each parser in turn: fuzz/run.sh SECONDS [PARSER...]. MORE: a folder with further volume files for seeds. A table of what was run, and an error if anything was found.
set -euo pipefail
cd "$(dirname "$0")/.."
seconds=${1:?fuzz/run.sh SECONDS [PARSER...]}
shift
parsers=("$@")
cargo fuzz --version > /dev/null || { echo "cargo install cargo-fuzz" >&2; exit 3; }
cargo run --quiet -p fuzz --bin seeds -- fuzz/corpus ${MORE:+"$MORE"}
((${#parsers[@]})) || mapfile -t parsers < <(cd fuzz/targets && ls -- *.rs | sed 's/\.rs$//')
programs="target/$(rustc -vV | sed -n 's/^host: //p')/release"
for parser in "${parsers[@]}"; do
  # Linking all of it at once for each parser would take longer than it gains.
  CARGO_PROFILE_RELEASE_LTO=off CARGO_PROFILE_RELEASE_CODEGEN_UNITS=16 cargo fuzz build -s none --features libfuzzer "$parser" > /dev/null 2> fuzz/build.log ||
    { cat fuzz/build.log >&2; exit 3; }
done
found=0
TIMEFORMAT='%U %S'
echo "| parser | seconds | of a processor | executions | a second | corpus | features | peak memory MB | found |"
echo "|---|---|---|---|---|---|---|---|---|"
for parser in "${parsers[@]}"; do
  log="fuzz/$parser.log"
  outcome=nothing
  mkdir -p "fuzz/artifacts/$parser"
  { time "$programs/$parser" -max_total_time="$seconds" -max_len=65536 -rss_limit_mb=1024 -timeout=25 -print_final_stats=1 \
    -artifact_prefix="fuzz/artifacts/$parser/" "fuzz/corpus/$parser" > "$log" 2>&1 || { outcome="see $log"; found=1; }; } 2> "fuzz/$parser.time.log"
  stat() { sed -n "s/^stat::$1: *//p" "$log" | tail -n 1; }
  busy=$(awk '{ print int($1 + $2) }' "fuzz/$parser.time.log")
  features=$(grep -oE ' ft: [0-9]+' "$log" | tail -n 1 | tr -dc 0-9)
  echo "| $parser | $seconds | $busy | $(stat number_of_executed_units) | $(stat average_exec_per_sec) | $(find "fuzz/corpus/$parser" -type f | wc -l) | $features | $(stat peak_rss_mb) | $outcome |"
done
exit $found
