"""What of a scene the export does not carry: shown in the panel before the render. Needs no Blender."""

from . import materials, versions
from .camera import is_supported
from .versions import find_input

LOST_TYPES = {
    "VOLUME": "volume object",
    "CURVES": "hair curves",
    "POINTCLOUD": "point cloud",
    **dict.fromkeys(versions.GREASE_PENCIL, "grease pencil"),
}
MOST_NAMES = 3


def losses_of(scene):
    """Texts, each one loss with the names of what it concerns."""
    found = {}

    def lose(text, name=""):
        names = found.setdefault(text, [])
        if name and name not in names:
            names.append(name)

    for thing in scene.objects:
        if not thing.hide_render:
            look_at_object(thing, lose, scene)
    will_bake = scene.lumifold.bake_resolution > 0
    for material, has_uv in materials_of(scene):
        baked = materials.Texture("") if will_bake and has_uv else None
        for text in materials.translate(material, lambda *place, baked=baked: baked).losses:
            lose(text, material.name)
    if scene.camera is None:
        lose("No camera: nothing can be rendered")
    else:
        look_at_camera(scene.camera, lose)
    look_at_render(scene, lose)
    return [line(text, names) for text, names in found.items()]


def line(text, names):
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return f"{text}: {', '.join(names[:MOST_NAMES])}{more}" if names else text


def materials_of(scene):
    """The materials of what is rendered, each once, and whether all that have it have a UV map."""
    found = {}
    for thing in scene.objects:
        if not thing.hide_render:
            has_uv = thing.type == "MESH" and bool(getattr(thing.data, "uv_layers", None))
            for slot in thing.material_slots:
                if slot.material is not None:
                    _, others = found.get(slot.material.name, (None, True))
                    found[slot.material.name] = slot.material, has_uv and others
    return found.values()


def look_at_object(thing, lose, scene):
    if thing.type in LOST_TYPES:
        lose(f"Not rendered, {LOST_TYPES[thing.type]}", thing.name)
    for system in thing.particle_systems:
        if system.settings.type == "HAIR" and system.settings.render_type == "PATH":
            lose("Not rendered, hair", thing.name)
    if versions.has_light_linking(thing):
        lose("Light linking (lights reach all objects)", thing.name)
    if thing.type == "LIGHT":
        look_at_light(thing, lose, scene.lumifold.soft_points)
    elif any(not getattr(thing, f"visible_{ray}", True)
             for ray in ("camera", "diffuse", "glossy", "transmission", "shadow")):
        lose("Ray visibility (all rays see it)", thing.name)
    elif thing.is_holdout:
        lose("Holdout", thing.name)
    elif thing.is_shadow_catcher and not scene.render.film_transparent:
        lose("Shadow catcher without a transparent film (shown like others)", thing.name)


def look_at_light(thing, lose, soft_points):
    light = thing.data
    tree = versions.node_tree(light)
    if tree and not is_plain(tree):
        lose("Light with nodes (its own colour and power count)", thing.name)
    if light.type == "AREA":
        lose("Area light is a mesh: the camera sees it, and its back casts shadows", thing.name)
        if getattr(light, "spread", 3.2) < 3.14:
            lose("Spread of area light", thing.name)
    elif light.type == "POINT" and light.shadow_soft_size > 0:
        if soft_points:
            lose("Point light is a sphere: the camera sees it", thing.name)
        else:
            lose("Radius of light (sharp shadows)", thing.name)
    elif light.type == "SPOT":
        if light.shadow_soft_size > 0:
            lose("Radius of light (sharp shadows)", thing.name)
        lose("Falloff of spot: glTF's, without Cycles' cosine", thing.name)
    elif light.type == "SUN" and light.angle > 0:
        lose("Angle of sun (sharp shadows)", thing.name)


def is_plain(tree):
    """Whether a light's nodes are those that Blender makes: an emission of strength 1 and the light's
    colour."""
    emissions = [node for node in tree.nodes if node.type == "EMISSION"]
    return len(tree.nodes) <= 2 and all(
        not any(socket.is_linked for socket in node.inputs)
        and find_input(node, "Strength").default_value == 1
        and tuple(find_input(node, "Color").default_value)[:3] == (1, 1, 1)
        for node in emissions
    )


def look_at_camera(camera, lose):
    data = camera.data
    if not is_supported(data):
        lose("Camera that is neither perspective nor orthographic: nothing can be rendered", camera.name)
    if data.shift_x or data.shift_y:
        lose("Shift of camera", camera.name)
    if data.dof.use_dof and (data.dof.aperture_blades or data.dof.aperture_ratio != 1):
        lose("Blades and ratio of the aperture (round)", camera.name)
    if data.dof.use_dof and data.type != "PERSP":
        lose("Depth of field of an orthographic camera", camera.name)


def look_at_render(scene, lose):
    render = scene.render
    if render.pixel_aspect_x != render.pixel_aspect_y:
        lose("Aspect of pixels (square)")
    if render.use_motion_blur:
        lose("Motion blur")
    if render.use_multiview:
        lose("Stereoscopy")
    tree = versions.node_tree(scene.world) if scene.world else None
    if tree:
        for node in tree.nodes:
            if node.type == "OUTPUT_WORLD" and node.is_active_output and find_input(node, "Volume").is_linked:
                lose("Volume of world", scene.world.name)
            if node.type == "LIGHT_PATH":
                lose("'Light Path' of world (all rays see the same)", scene.world.name)
