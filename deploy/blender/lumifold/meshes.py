"""Evaluated meshes of Blender as primitives of glTF."""

import numpy

from . import versions
from .gltf import y_up

TYPES = {"MESH", "CURVE", "SURFACE", "FONT", "META"}


def primitives_of(builder, thing, writer):
    """The primitives of an evaluated object, with materials of a MaterialWriter."""
    mesh = thing.to_mesh()
    if mesh is None:
        return []
    try:
        if not mesh.polygons:
            return []
        corners, triangles, slots = read_mesh(mesh)
        uv_names = uv_order(mesh)
        materials = [slot.material for slot in thing.material_slots] or [None]
        made = []
        for slot in numpy.unique(slots):
            used, indices = numpy.unique(triangles[slots == slot], return_inverse=True)
            material = materials[min(slot, len(materials) - 1)]
            colors = corner_colors(mesh, writer.vertex_colors(thing, material))
            end = 6 + 2 * len(uv_names)
            whole = corners[used] if colors is None else numpy.hstack([corners[used], colors[used]])
            rows, _, inverse = distinct_rows(whole)
            indices = inverse[indices].reshape(-1, 3)
            uvs = [rows[:, 6 + 2 * i : 8 + 2 * i] for i in range(len(uv_names))]
            made.append(
                builder.primitive(rows[:, :3], indices, writer.index(thing, material, tuple(uv_names)), rows[:, 3:6],
                                  uvs, None if colors is None else rows[:, end:]))
        return made
    finally:
        thing.to_mesh_clear()


def uv_order(mesh):
    """Names of the UV maps, that of rendering first; glTF's renderers read two."""
    layers = sorted(mesh.uv_layers, key=lambda layer: not layer.active_render)
    return [layer.name for layer in layers[:2]]


def read_mesh(mesh):
    """Per corner of a face: position, normal and UVs, in glTF's axes; per triangle its corners and its
    material slot."""
    mesh.calc_loop_triangles()
    count = len(mesh.loops)
    positions = get(mesh.vertices, "co", 3)[get(mesh.loops, "vertex_index", 1, numpy.int32)]
    normals = get(*versions.corner_normals(mesh), 3)
    columns = [y_up(positions), y_up(normals)]
    for name in uv_order(mesh):
        uv = get(*versions.corner_uvs(mesh.uv_layers[name]), 2)
        columns.append(numpy.column_stack([uv[:, 0], 1 - uv[:, 1]]))
    corners = numpy.hstack(columns).astype(numpy.float32)
    assert len(corners) == count
    triangles = get(mesh.loop_triangles, "loops", 3, numpy.int32)
    slots = get(mesh.loop_triangles, "material_index", 1, numpy.int32)
    return corners, triangles, slots


def corner_colors(mesh, name):
    """Linear RGB of a colour attribute per corner ("": that of rendering), or None where the mesh has none."""
    if name is None or not len(mesh.color_attributes):
        return None
    attribute = mesh.color_attributes.get(name) if name else mesh.color_attributes[max(
        mesh.color_attributes.render_color_index, 0)]
    if attribute is None:
        return None
    colors = get(attribute.data, "color", 4)[:, :3]
    return colors if attribute.domain == "CORNER" else colors[get(mesh.loops, "vertex_index", 1, numpy.int32)]


def get(collection, name, components, kind=numpy.float32):
    values = numpy.empty(len(collection) * components, kind)
    collection.foreach_get(name, values)
    return values.reshape(-1, components) if components > 1 else values


def distinct_rows(rows):
    """Rows that occur once, where each occurs first, and the number of each old row among them."""
    rows = numpy.ascontiguousarray(rows + 0.0)  # -0 becomes 0
    as_bytes = rows.view(numpy.dtype((numpy.void, rows.dtype.itemsize * rows.shape[1]))).ravel()
    _, first, inverse = numpy.unique(as_bytes, return_index=True, return_inverse=True)
    return rows[first], first, inverse.reshape(-1)
