#!/usr/bin/env bash
# Makes lumifold-blender.zip, which Blender installs: deploy/blender/package.sh [FOLDER]
set -euo pipefail
folder=$(cd "${1:-.}" && pwd)
cd "$(dirname "$0")"
python3 - "$folder/lumifold-blender.zip" <<'PYTHON'
import pathlib, sys, zipfile

with zipfile.ZipFile(sys.argv[1], "w", zipfile.ZIP_DEFLATED) as made:
    for path in sorted(pathlib.Path("lumifold").glob("*.py")):
        made.write(path)
PYTHON
echo "$folder/lumifold-blender.zip"
