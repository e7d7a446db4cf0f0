#!/usr/bin/env python3
"""Prints what a program is made of, as a CycloneDX 1.5 inventory (SBOM) in JSON: the Debian packages of the
shared libraries that it is linked with, directly or by others, and those that it was built with. The same
program, machine and time make the same inventory.

    inventory.py PROGRAM --time SECONDS
"""

import argparse
import datetime
import json
import os
import pathlib
import re
import subprocess
import uuid

SETUP = pathlib.Path(__file__).parents[1] / "setup.sh"


def output_of(*command):
    return subprocess.run(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL).stdout


def libraries(program):
    """The files of the shared libraries that the loader takes."""
    return sorted({os.path.realpath(path) for path in re.findall(r"=> (/\S+)", output_of("ldd", program))})


def owners(files):
    """The packages of the files. dpkg may know a file of /usr by its name before the folders were merged."""
    lines = output_of("dpkg-query", "-S", *files, *(file.removeprefix("/usr") for file in files)).splitlines()
    return {line.split(":")[0] for line in lines}


def build_packages():
    return set(re.search(r"^packages=\((.*?)\)", SETUP.read_text(), re.M | re.S)[1].split())


def component(package, scope):
    version, architecture, source, homepage = output_of(
        "dpkg-query", "-W", "-f=${Version}\t${Architecture}\t${source:Package}\t${Homepage}\n",
        package).splitlines()[0].split("\t")
    url = f"pkg:deb/debian/{package.replace('+', '%2B')}@{version.replace('+', '%2B').replace(':', '%3A')}?arch={architecture}"
    made = {
        "type": "library", "bom-ref": url, "name": package, "version": version, "scope": scope, "purl": url,
        "properties": [{"name": "debian:source", "value": source}]
    }
    if homepage:
        made["externalReferences"] = [{"type": "website", "url": homepage}]
    return made


def inventory(program, seconds):
    linked = owners(libraries(program))
    components = [component(package, "required") for package in sorted(linked)]
    components += [component(package, "excluded") for package in sorted(build_packages() - linked)]
    version = re.search(r"\d+(\.\d+)+", output_of(program, "--version"))[0]
    root = {"type": "application", "bom-ref": program.name, "name": program.name, "version": version,
            "licenses": [{"license": {"id": "Apache-2.0"}}]}
    made = {
        "$schema": "http://cyclonedx.org/schema/bom-1.5.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "timestamp": datetime.datetime.fromtimestamp(seconds, datetime.timezone.utc).isoformat(),
            "component": root
        },
        "components": components,
        "dependencies": [{
            "ref": root["bom-ref"],
            "dependsOn": [one["bom-ref"] for one in components if one["scope"] == "required"]
        }],
    }
    made["serialNumber"] = uuid.uuid5(uuid.NAMESPACE_URL, json.dumps(made)).urn
    return made


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("--time", type=int, required=True, help="of the inventory, in seconds since 1970")
    arguments = parser.parse_args()
    print(json.dumps(inventory(arguments.program, arguments.time), indent=1))


if __name__ == "__main__":
    main()
