#!/usr/bin/env bash
# Installs what the tests need, builds, and runs every test.
#   tests/run.sh          the gate: all but the tests labelled "slow"
#   tests/run.sh --full   those too, the sanitizer builds, and clang-tidy on every file
# LUMIFOLD_SCENES_DIR names a folder with real scenes; tests that need one say so and skip where it is not
# set. LUMIFOLD_TIDY_BASE names the commit clang-tidy compares with (default: the last one).
set -euo pipefail
cd "$(dirname "$0")/.."

full=false
[ "${1:-}" = --full ] && full=true
step() { printf '\n== %s (%d s)\n' "$1" "$SECONDS"; }

deploy/setup.sh --tests
step 'configure'
cmake --preset gate >/dev/null
step 'build'
cmake --build --preset gate $($full && echo --target all benches) 2>&1 | tee build/release/build.log
# A cached object of a build without -Werror repeats its warnings and does not fail.
if grep -n 'warning:' build/release/build.log; then exit 1; fi
step 'format and lint'
tests/lint.sh "$($full && echo --all || echo --changed)"
if $full; then
  for preset in asan-ubsan tsan; do
    step "$preset"
    cmake --workflow --preset "$preset"
  done
fi
step 'test'
# At the priority of workers, who would starve beside tests that run at the same time.
nice -n 10 ctest --preset gate $($full || echo --label-exclude slow)
step 'done'
