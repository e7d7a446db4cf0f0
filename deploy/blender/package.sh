#!/usr/bin/env bash
# Packages the add-on both ways: deploy/blender/package.sh [FOLDER]
#   lumifold-blender.zip            an add-on, for Blender 3.4 and later
#   lumifold-blender-extension.zip  an extension, for Blender 4.2 and later
set -euo pipefail
folder=$(cd "${1:-.}" && pwd)
cd "$(dirname "$0")"
python3 - "$folder" <<'PYTHON'
import pathlib, sys, zipfile

code = sorted(pathlib.Path("lumifold").glob("*.py"))
# Blender takes an archive with a manifest for an extension, and looks for it at the top.
packages = {
    "lumifold-blender.zip": {path: path for path in code},
    "lumifold-blender-extension.zip": {path: path.name for path in [*code, pathlib.Path("lumifold/blender_manifest.toml")]},
}
for name, files in packages.items():
    package = pathlib.Path(sys.argv[1], name)
    with zipfile.ZipFile(package, "w", zipfile.ZIP_DEFLATED) as made:
        for path, place in files.items():  # without times: the same files make the same package
            made.writestr(zipfile.ZipInfo(str(place)), path.read_bytes(), zipfile.ZIP_DEFLATED)
    print(package)
PYTHON
