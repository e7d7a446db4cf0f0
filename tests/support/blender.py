"""The Blender of the tests: the program LUMIFOLD_BLENDER, or `blender` on the PATH."""

import functools
import os
import re
import shutil
import subprocess
import unittest

PROGRAM = shutil.which(os.environ.get("LUMIFOLD_BLENDER", "blender"))
MISSING = "there is no blender on this machine (Debian packages blender, python3-numpy); LUMIFOLD_BLENDER names another one"
# Blender's Python takes its library from beside the first python3 on the path, which must be the system's.
ENVIRONMENT = {**os.environ, "PATH": os.defpath}


def require():
    """For setUpModule: skips out loud without a Blender."""
    if PROGRAM is None:
        print(f"SKIPPED: {MISSING}")
        raise unittest.SkipTest(MISSING)


@functools.cache
def version():
    """Major and minor number."""
    printed = subprocess.run([PROGRAM, "--version"],
                             env=ENVIRONMENT,
                             capture_output=True,
                             text=True,
                             check=True).stdout
    return tuple(map(int, re.search(r"Blender (\d+)\.(\d+)", printed).groups()))


def command(script, *arguments, options=()):
    """Runs a script without a window and with factory settings."""
    return [
        PROGRAM, "-b", "--factory-startup", *options, "--python-exit-code", "1", "--python", script, "--",
        *arguments
    ]


def expression(code, *arguments):
    """Runs code instead of a script."""
    return [
        PROGRAM, "-b", "--factory-startup", "--python-exit-code", "1", "--python-expr", code, "--", *arguments
    ]
