#!/bin/sh
# Cells that a run does not measure stay unchanged on the page, and a figure worse than the kept one is an error:
# keeps_cells.sh LUMIFOLD_STABILITY.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
program=$1
run() { "$program" --cache "$folder/films" --output "$folder" --case 35 --column "$1" > /dev/null; }
fail() { echo "$1" >&2; exit 1; }

run none
run epanechnikov
grep -q '^| 35 | lights of 10,000:1 | .* \*\*FAIL\*\* | – |$' "$folder/stability.md" || fail "the first method's cell is lost"
grep -q '^35,.*,epanechnikov,.*,not applicable: it needs what a film' "$folder/stability.csv" || fail "no reason"
# A figure is read from the file, not measured again ...
sed -i '/,none,/s/,[^,]*,[^,]*$/,7,fail/' "$folder/stability.csv"
run epanechnikov
grep -q '| 7, 7 \*\*FAIL\*\* | – |' "$folder/stability.md" || fail "a kept figure is not on the page"
# ... unless the run measures it.
run none
grep -q '7, 7 \*\*FAIL' "$folder/stability.md" && fail "a figure is not replaced"
# Figures of measures that have another name now are dropped.
sed -i '/,none,/s/,error,/,squares,/' "$folder/stability.csv"
run epanechnikov
grep -q ',none,' "$folder/stability.csv" && fail "figures of another measure are kept"
run none
cp "$folder/stability.csv" "$folder/whole.csv"
echo '35,"lights of 10,000:1",none' >> "$folder/stability.csv"
run none 2> "$folder/error" && fail "a line cut short is taken for a cell"
grep -q 'stability.csv:[0-9]*: not a cell' "$folder/error" || fail "the line is not named"
mv "$folder/whole.csv" "$folder/stability.csv"

# The default method against its kept figures.
compare() { "$program" --cache "$folder/films" --case 35 --column default --kept "$folder/$1" > /dev/null 2> "$folder/error"; }
# Writes FILE with the figure of measure $2 times $3.
scale() {
  awk -F, -v OFS=, -v measure="$2" -v factor="$3" \
    '/,default,/ && $(NF - 3) == measure { $(NF - 1) *= factor } { print }' "$folder/stability.csv" > "$folder/$1"
}
compare stability.csv && fail "a cell that was never recorded passes"
grep -q 'case 35, lights of 10,000:1: no figures are kept' "$folder/error" || fail "the missing cell is not named"
run default
compare stability.csv || fail "equal figures fail: $(cat "$folder/error")"
scale slightly.csv shift 0.97
compare slightly.csv || fail "a difference below 5 % fails"
scale better.csv shift 2
compare better.csv || fail "an improvement fails"
scale worse.csv shift 0.9
compare worse.csv && fail "a figure that is worse by a tenth passes"
grep -q 'case 35, lights of 10,000:1, shift: [0-9.e-]* before, [0-9.e-]* now' "$folder/error" || fail "the figures are not named"
# Below 1 % of the threshold no difference counts.
"$program" --cache "$folder/films" --output "$folder" --case 2 --column default > /dev/null
sed -i '/^2,.*,default,/s/,[^,]*,pass$/,1e-20,pass/' "$folder/stability.csv"
"$program" --cache "$folder/films" --case 2 --column default --kept "$folder/stability.csv" > /dev/null ||
  fail "a figure far below its threshold counts"
