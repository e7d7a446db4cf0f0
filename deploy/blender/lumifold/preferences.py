"""Preferences of the add-on: where the program `lumifold` is."""

import shutil

import bpy


class LumifoldPreferences(bpy.types.AddonPreferences):
    bl_idname = __package__

    program: bpy.props.StringProperty(
        name="Program",
        description="The program lumifold; empty: the one on the PATH",
        subtype="FILE_PATH",
    )

    def draw(self, _context):
        self.layout.prop(self, "program")
        found = program_path()
        self.layout.label(text=f"Found: {found}" if found else MISSING, icon="INFO" if found else "ERROR")


MISSING = "The program lumifold is not on the PATH: set its path in the preferences of the add-on"


def program_path():
    """Path of the program, or None where there is none."""
    addon = bpy.context.preferences.addons.get(__package__)
    chosen = addon.preferences.program if addon and addon.preferences else ""
    return bpy.path.abspath(chosen) if chosen else shutil.which("lumifold")


def register():
    bpy.utils.register_class(LumifoldPreferences)


def unregister():
    bpy.utils.unregister_class(LumifoldPreferences)
