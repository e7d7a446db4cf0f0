"""Makes a wheel of the package (PEP 427): make_wheel.py FOLDER VERSION OUT.

The same sources make the same bytes.
"""

import base64
import hashlib
import pathlib
import sys
import zipfile

METADATA = """Metadata-Version: 2.1
Name: lumifold
Version: {version}
Summary: Renders glTF scenes on a Lumifold farm
License: Apache-2.0
Requires-Python: >=3.9
Requires-Dist: grpcio>=1.49
Requires-Dist: protobuf>=3.20.2
Requires-Dist: xxhash>=2
"""
WHEEL = "Wheel-Version: 1.0\nGenerator: lumifold\nRoot-Is-Purelib: true\nTag: py3-none-any\n"


def make(package, version, out):
    info = f"lumifold-{version}.dist-info"
    files = {
        path.relative_to(package.parent).as_posix(): path.read_bytes()
        for path in sorted(package.rglob("*")) if path.suffix == ".py" or path.name == "py.typed"
    }
    files[f"{info}/METADATA"] = METADATA.format(version=version).encode()
    files[f"{info}/WHEEL"] = WHEEL.encode()
    record = []
    for name, content in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        record.append(f"{name},sha256={digest},{len(content)}")
    files[f"{info}/RECORD"] = "\n".join([*record, f"{info}/RECORD,,", ""]).encode()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as wheel:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name)  # of 1980, the format's first day
            entry.external_attr = 0o644 << 16
            wheel.writestr(entry, content, zipfile.ZIP_DEFLATED)


if __name__ == "__main__":
    make(pathlib.Path(sys.argv[1]), sys.argv[2], pathlib.Path(sys.argv[3]))
