#!/bin/sh
# Cells that a run does not measure stay unchanged on the page: keeps_cells.sh LUMIFOLD_STABILITY.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
run() { "$1" --cache "$folder/films" --output "$folder" --case 35 --column "$2" > /dev/null; }
fail() { echo "$1" >&2; exit 1; }

run "$1" none
run "$1" epanechnikov
grep -q '^| 35 | lights of 10,000:1 | .* \*\*FAIL\*\* | – |$' "$folder/stability.md" || fail "the first method's cell is lost"
grep -q '^35,.*,epanechnikov,.*,not applicable: it needs what a film' "$folder/stability.csv" || fail "no reason"
# A figure is read from the file, not measured again ...
sed -i '/,none,/s/,[^,]*,[^,]*$/,7,fail/' "$folder/stability.csv"
run "$1" epanechnikov
grep -q '| 7, 7 \*\*FAIL\*\* | – |' "$folder/stability.md" || fail "a kept figure is not on the page"
# ... unless the run measures it.
run "$1" none
grep -q '7, 7 \*\*FAIL' "$folder/stability.md" && fail "a figure is not replaced"
echo '35,"lights of 10,000:1",none' >> "$folder/stability.csv"
run "$1" none 2> "$folder/error" && fail "a line cut short is taken for a cell"
grep -q 'stability.csv:[0-9]*: not a cell' "$folder/error" || fail "the line is not named"
