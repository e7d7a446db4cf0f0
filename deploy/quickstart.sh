#!/usr/bin/env bash
# From a fresh Debian 12 or 13 to a filtered picture: installs what is missing, builds, renders the Cornell
# box through coordinator, worker and filter in one process, and says where the pictures are and what the
# filter gained. Needs root or sudo the first time.
set -euo pipefail
cd "$(dirname "$0")/.."

deploy/setup.sh
echo "quickstart: building (the first time takes some minutes)" >&2
cmake --preset release >build-quickstart.log 2>&1 || { cat build-quickstart.log >&2; exit 1; }
cmake --build --preset release --target lumifold_client lumifold_server lumifold_worker lumifold_scenes_program >>build-quickstart.log 2>&1 ||
  { tail -50 build-quickstart.log >&2; exit 1; }
mkdir -p build/quickstart
mv build-quickstart.log build/quickstart/build.log

bin=build/release/bin
out=build/quickstart
"$bin/lumifold-scenes" --out "$out" cornell-box >/dev/null
"$bin/lumifold" render "$out/cornell-box.glb" --size 512x384 --spp 64 --seed 0 \
  -o "$out/cornell-box.exr" --exr full --noisy "$out/cornell-box-noisy.png"
# The same picture for people to look at: a conversion, nothing is rendered again.
"$bin/lumifold" convert "$out/cornell-box.exr" -o "$out/cornell-box.png"

# Mean squared error on the scale of 0..255, against a reference of 1024 samples per pixel, rounded to 8
# significant bits.
mse() { "$bin/lumifold" compare "$out/cornell-box.exr" deploy/cornell-box-reference.exr "$@" | sed -n 's/^MSE255 *//p'; }
cat <<EOT

  filtered picture  $PWD/$out/cornell-box.png
  as it was traced  $PWD/$out/cornell-box-noisy.png
  all layers        $PWD/$out/cornell-box.exr
  error (MSE255)    $(mse --layer noisy) as traced, $(mse) filtered
EOT
