#!/usr/bin/env bash
# clang-format on all C++ files (check only), clang-tidy on those changed since LUMIFOLD_TIDY_BASE (--changed)
# or on all (--all). Both of LLVM 19, which Debian 12 and 13 have: other versions format and find otherwise.
# Clang's static analyzer, a part of clang-tidy, follows calls with --all only: that takes half of the time.
set -euo pipefail
cd "$(dirname "$0")/.."
git rev-parse --git-dir >/dev/null 2>&1 || { echo "lint: skipped: not a checkout of Git"; exit 0; }

sources() { git ls-files '*.h' '*.cc'; }
sources | xargs -r clang-format-19 --dry-run --Werror

base=${LUMIFOLD_TIDY_BASE:-HEAD~1}
shallow=(--extra-arg=-Xclang --extra-arg=-analyzer-config --extra-arg=-Xclang --extra-arg=mode=shallow)
case "${1:---changed}" in
  --all) shallow=() files=$(git ls-files '*.cc') ;;
  --changed) files=$(git rev-parse -q --verify "$base" >/dev/null && git diff --name-only --diff-filter=d "$base" -- '*.cc' || true) ;;
  *) echo "usage: tests/lint.sh [--changed|--all]" >&2; exit 2 ;;
esac
[ -n "$files" ] || { echo "lint: no changed files"; exit 0; }
# clang does not read gcc's precompiled headers: it gets the commands without them.
python3 tests/structure/clang_checks.py commands build/release
echo "$files" | xargs -r -n 1 -P "$(nproc)" clang-tidy-19 --quiet "${shallow[@]}" -p build/release/clang
