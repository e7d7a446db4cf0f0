"""A digest of all values of a tree of nodes, by which what was baked from it is known again."""

import hashlib


def of(node_tree):
    lines = []
    trees = [node_tree]
    for tree in trees:
        for node in tree.nodes:
            lines.append(repr(values_of(node)))
            lines += [repr(values_of(socket)) for socket in node.inputs]
            image = getattr(node, "image", None)
            if image is not None:
                lines.append(f"{image.name} {image.filepath} {tuple(image.size)} {image.is_dirty} "
                             f"{image.colorspace_settings.name}")
            if getattr(node, "node_tree", None) and node.node_tree not in trees:
                trees.append(node.node_tree)
            ramp = getattr(node, "color_ramp", None)
            lines += [f"{one.position} {tuple(one.color)}" for one in ramp.elements] if ramp else []
        lines += [f"{link.from_socket.path_from_id()} {link.to_socket.path_from_id()}" for link in tree.links]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def values_of(thing):
    """Names and values of the properties that are plain."""
    values = []
    for name in thing.bl_rna.properties.keys():
        value = getattr(thing, name, None)
        if isinstance(value, (bool, int, float, str)):
            values.append((name, value))
        elif type(value).__name__ in ("bpy_prop_array", "Vector", "Euler", "Color"):
            values.append((name, tuple(value)))
    return values
