"""Lumifold as a render engine of Blender: renders by path tracing on this machine or on a farm."""

import importlib.util

bl_info = {
    "name": "Lumifold",
    "author": "The Lumifold authors",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "category": "Render",
    "location": "Properties > Render > Render Engine",
    "description": "Renders on this machine or on a farm, and removes the noise",
    "support": "COMMUNITY",
}


def modules():
    """The modules with classes of Blender, in the order of registration. Imported late: the others work
    without Blender."""
    from . import engine, operators, panel, preferences, settings

    return preferences, settings, engine, operators, panel


def require_numpy():
    """Says in one sentence what is missing: Debian's Blender comes without it."""
    if importlib.util.find_spec("numpy") is None:
        raise ImportError("Lumifold needs numpy in Blender's Python: install the Debian package python3-numpy, "
                          "or `python3 -m pip install numpy` with Blender's own Python") from None


def register():
    require_numpy()
    for module in modules():
        module.register()


def unregister():
    for module in reversed(modules()):
        module.unregister()
