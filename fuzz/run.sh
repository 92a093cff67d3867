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
found=0
echo "| parser | seconds | executions | executions a second | corpus | peak memory MB | found |"
echo "|---|---|---|---|---|---|---|"
for parser in "${parsers[@]}"; do
  log="fuzz/$parser.log"
  outcome=nothing
  cargo fuzz run -s none --features libfuzzer "$parser" -- -max_total_time="$seconds" -max_len=65536 -rss_limit_mb=1024 -timeout=25 \
    -print_final_stats=1 > "$log" 2>&1 || { outcome="see $log"; found=1; }
  stat() { sed -n "s/^stat::$1: *//p" "$log" | tail -n 1; }
  echo "| $parser | $seconds | $(stat number_of_executed_units) | $(stat average_exec_per_sec) | $(find "fuzz/corpus/$parser" -type f | wc -l) | $(stat peak_rss_mb) | $outcome |"
done
exit $found
