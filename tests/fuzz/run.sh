#!/usr/bin/env bash
# Builds the fuzz target of the scene loader with clang, in a build folder of its own, and runs it.
#   tests/fuzz/run.sh SECONDS [RUNS]    runs for at most so many seconds and, where given, so many inputs
# Ends with 0 when nothing was found, 77 where there is no clang with libFuzzer, and otherwise with an error; the input
# at fault then lies in build/fuzz/found. The seeds come from programs of another build, in LUMIFOLD_BIN (default:
# build/release/bin): the documents of fuzz-gltf and the smaller scenes of lumifold-scenes.
set -euo pipefail
seconds=${1:?usage: tests/fuzz/run.sh SECONDS [RUNS]}
runs=${2:--1}
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
build=$root/build/fuzz
programs=${LUMIFOLD_BIN:-$root/build/release/bin}
max_bytes=65536

mkdir -p "$build/corpus" "$build/found" "$build/seeds"
if ! echo 'extern "C" int LLVMFuzzerTestOneInput(const char*, unsigned long) { return 0; }' |
  clang++ -fsanitize=fuzzer -x c++ - -o "$build/probe" 2>/dev/null; then
  echo "fuzz: skipped: no clang++ with libFuzzer (packages clang, libclang-rt-dev)" >&2
  exit 77
fi

cmake -S "$root" -B "$build" -G Ninja -DCMAKE_CXX_COMPILER=clang++ -DCMAKE_BUILD_TYPE=Release \
  -DCMAKE_CXX_FLAGS_RELEASE='-O1 -g1 -fno-sanitize-recover=all' \
  -DLUMIFOLD_SANITIZE=fuzzer-no-link,address,undefined -DLUMIFOLD_FUZZ=ON -DLUMIFOLD_BUILD_TESTS=OFF \
  -DLUMIFOLD_BUILD_FARM=OFF -DLUMIFOLD_WERROR=OFF >/dev/null
cmake --build "$build" --target gltf_fuzz

"$programs/fuzz-gltf" --write-seeds "$build/seeds"
"$programs/lumifold-scenes" --out "$build/seeds" >/dev/null
find "$build/seeds" -type f -size +$((max_bytes / 1024))k -delete

export UBSAN_OPTIONS=print_stacktrace=1
export ASAN_OPTIONS=allocator_may_return_null=0:detect_leaks=1
exec "$build/bin/gltf_fuzz" -max_total_time="$seconds" -runs="$runs" -rss_limit_mb=2048 -timeout=30 \
  -max_len=$max_bytes -dict="$here/gltf.dict" -artifact_prefix="$build/found/" -seed=1 -print_final_stats=1 \
  -verbosity=0 "$build/corpus" "$build/seeds"
