#!/usr/bin/env python3
"""Renders a scene on a farm: uploads it, submits a job, follows it and saves the picture, over TLS.

    farm.py SCENE.glb OUT.exr [PROFILE]

PROFILE is one of `lumifold login` (default: "default"). Needs the Python package, python3-lumifold.
"""

import sys

from lumifold import Farm


def render(scene, output, profile="default"):
    with Farm(profile=profile) as farm:
        job = farm.render(scene, size=(320, 240), samples=16)
        job.wait(progress=lambda status: print(f"{job.id}: {status}", file=sys.stderr))
        job.save(output)
    print(job.id)


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    render(*sys.argv[1:])
