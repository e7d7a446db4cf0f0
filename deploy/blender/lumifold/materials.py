"""Materials of Blender as those of glTF: reads node trees. What a tree has that glTF cannot carry is listed.
Needs no Blender."""

import dataclasses
import math

from . import mixtures, versions
from .versions import WHITE, find_input, is_number

# Losses that concern every material of a kind are counted, not named one by one.
DISNEY_DIFFUSE = "Principled's diffuse lobe is Lambert's: up to 3 % darker, closed rooms up to 20 %"
SINGLE_SCATTERING = "Rough metal is as bright as with 'Multiscatter GGX': Cycles' 'GGX' loses light"
SHEEN = "Principled's sheen is another model than glTF's"
SMOOTH = 0.4  # roughness up to which that is less than some 5 % of the light


@dataclasses.dataclass(frozen=True)
class Texture:
    """A picture, or one of its channels."""

    image: object
    channels: str = "RGB"  # or "R", "G", "B", "A"
    uv_map: str = ""  # empty: that of rendering
    transform: tuple = ()  # offset x, y, rotation, scale x, y of a Mapping node
    extension: str = "REPEAT"
    factor: float = 1.0  # of a colour


@dataclasses.dataclass
class Material:
    """What glTF says about a surface. A property is a number, a tuple or a Texture."""

    name: str = ""
    base_color: object = (0.8, 0.8, 0.8)
    vertex_colors: str = None  # a colour attribute that multiplies it; "": that of rendering
    metallic: object = 0.0
    roughness: object = 1.0
    alpha: object = 1.0
    reflectance: float = 0.04  # at normal incidence; 0: no highlight
    emission: object = (0.0, 0.0, 0.0)
    emission_strength: float = 0.0
    transmission: object = 0.0
    is_thin: bool = False  # a pane that does not bend light, not a solid
    ior: float = 1.5
    clearcoat: float = 0.0
    clearcoat_roughness: float = 0.0
    sheen_color: tuple = (0.0, 0.0, 0.0)
    sheen_roughness: float = 0.0
    anisotropy: float = 0.0  # as Principled has it
    anisotropy_rotation: float = 0.0  # turns
    normal: object = None
    normal_strength: float = 1.0
    double_sided: bool = True
    losses: list = dataclasses.field(default_factory=list)
    baked: object = None  # baked(node, socket, kind): the picture of an input that glTF cannot carry, or None


def translate(material, baked=lambda node, socket, kind: None):
    """The glTF material of one of Blender's, with its losses. `baked` is asked for a picture of each input that
    only a picture carries: names of node and socket, and "COLOR" or "NORMAL"."""
    made = Material(name=material.name, double_sided=not material.use_backface_culling, baked=baked)
    tree = versions.node_tree(material)
    if tree is None:
        made.base_color = tuple(material.diffuse_color[:3])
        made.metallic, made.roughness = material.metallic, material.roughness
        return made
    output = active_output(tree)
    surface = output and node_behind(find_input(output, "Surface"))
    if surface is None:
        made.base_color, made.reflectance = (0.0, 0.0, 0.0), 0.0
        has_volume = output and find_input(output, "Volume").is_linked
        made.alpha = 0.0 if has_volume else 1.0  # a volume alone has no surface to be seen
        made.losses.append("volume without a surface (not rendered)" if has_volume else "no surface shader")
    else:
        read_shader(made, surface)
    for name, what in (("Volume", "volumes"), ("Displacement", "displacement")):
        if output and find_input(output, name).is_linked and (surface or name != "Volume"):
            made.losses.append(what)
    return made


def active_output(tree):
    outputs = [
        node for node in tree.nodes if node.type == "OUTPUT_MATERIAL" and node.target in ("ALL", "CYCLES")
    ]
    active = [node for node in outputs if node.is_active_output]
    return (active or outputs or [None])[0]


def source_of(socket):
    """The socket that a link comes from, through reroutes; None if there is no link."""
    while socket.is_linked:
        socket = socket.links[0].from_socket
        if socket.node.type != "REROUTE":
            return socket
        socket = socket.node.inputs[0]
    return None


def node_behind(socket):
    source = source_of(socket)
    return source.node if source else None


def read_shader(made, node):
    reader = SHADERS.get(node.type)
    if reader is None:
        made.losses.append(f"shader node '{node.bl_label}' (rendered as a matt surface)")
        color = find_input(node, "Color")
        made.base_color = tuple(color.default_value[:3]) if color else made.base_color
        made.reflectance = 0.0
    else:
        reader(made, node)
    for name, neutral in versions.at(versions.LOST_INPUTS).get(node.type, {}).items():
        socket = find_input(node, name)
        if socket is not None and not has_value(socket, neutral):
            made.losses.append(f"{name} of '{node.bl_label}'")


def read_principled(made, node):
    value = Inputs(made, node, versions.principled_input)
    read_base(made, value, "Base Color")
    made.metallic = value.number("Metallic", may_be_texture=True)
    made.roughness = value.number("Roughness", may_be_texture=True)
    made.alpha = value.number("Alpha", may_be_texture=True)
    made.emission = value.color("emission")
    made.emission_strength = value.number("Emission Strength")
    made.transmission = value.number("transmission", may_be_texture=True)
    thin_wall = find_input(node, "Thin Wall")  # since Blender 5.2
    made.is_thin = thin_wall is not None and bool(thin_wall.default_value)
    made.ior = value.number("IOR")
    made.reflectance = versions.reflectance(value.number("specular"), made.ior)
    made.clearcoat = value.number("coat") * (versions.DISNEY_COAT if versions.is_disney() else 1)
    made.clearcoat_roughness = value.number("coat roughness")
    read_sheen(made, value)
    if is_number(made.roughness):
        made.anisotropy = value.number("Anisotropic")
        made.anisotropy_rotation = value.number("Anisotropic Rotation")
    elif value.number("Anisotropic") != 0:
        made.losses.append(f"Anisotropic of '{node.bl_label}' with a picture as roughness")
    read_normal(made, find_input(node, "Normal"))
    if made.metallic != 1 and made.transmission != 1 and versions.is_disney():
        made.losses.append(DISNEY_DIFFUSE)
    if made.metallic != 0 and getattr(node, "distribution", "") == "GGX" and not is_smooth(made.roughness):
        made.losses.append(SINGLE_SCATTERING)


def read_base(made, value, name):
    """The base colour, with a colour attribute that is it or multiplies it."""
    socket = value.find(value.node, name)
    made.vertex_colors, rest = vertex_colors_behind(socket)
    if made.vertex_colors is None:
        made.base_color = value.color(name)
    else:
        made.base_color = WHITE if rest is None else value.color_of(rest)


def vertex_colors_behind(socket):
    """The name of the colour attribute that a colour is multiplied with (None: no attribute), and the socket
    of the other factor, if there is one."""
    source = source_of(socket)
    if source is None:
        return None, None
    node = source.node
    if node.type == "VERTEX_COLOR" and source.name == "Color":
        return node.layer_name, None
    if node.type == "ATTRIBUTE" and source.name == "Color" and node.attribute_type == "GEOMETRY":
        return node.attribute_name, None
    if node.type in versions.MULTIPLIED and node.blend_type == "MULTIPLY":
        share, *factors = (find_input(node, name) for name in versions.MULTIPLIED[node.type])
        if not share.is_linked and share.default_value == 1:
            for one, other in (factors, reversed(factors)):
                name, rest = vertex_colors_behind(one)
                if name is not None and rest is None:
                    return name, other
    return None, None


def read_sheen(made, value):
    weight = value.number("sheen")
    if weight > 0:
        made.sheen_color = tuple(
            weight * channel for channel in value.color("Sheen Tint", may_be_texture=False))
        made.sheen_roughness = value.number("Sheen Roughness")
        made.losses.append(SHEEN)


def read_diffuse(made, node):
    read_base(made, Inputs(made, node), "Color")
    made.reflectance = 0.0
    read_normal(made, find_input(node, "Normal"))


def read_glossy(made, node):
    value = Inputs(made, node)
    read_base(made, value, "Color")
    made.metallic = 1.0
    made.roughness = 0.0 if node.distribution == "SHARP" else value.number("Roughness", may_be_texture=True)
    if made.base_color != WHITE:
        made.losses.append(
            "'Glossy BSDF' has no Fresnel effect; here it is a metal, whose colour turns white at grazing angles"
        )
    read_normal(made, find_input(node, "Normal"))


def read_glass(made, node):
    value = Inputs(made, node)
    made.base_color, made.transmission = value.color("Color"), 1.0
    made.roughness = 0.0 if node.distribution == "SHARP" else value.number("Roughness")
    made.ior = value.number("IOR")
    read_normal(made, find_input(node, "Normal"))


def read_emission(made, node):
    value = Inputs(made, node)
    made.base_color, made.reflectance = (0.0, 0.0, 0.0), 0.0
    made.emission, made.emission_strength = value.color("Color"), value.number("Strength")


def read_transparent(made, node):
    made.alpha = 0.0
    if Inputs(made, node).color("Color") != WHITE:
        made.losses.append("colour of 'Transparent BSDF'")


def read_mix(made, node):
    first, second = (node_behind(find_input(node, name)) for name in ("Shader", "Shader_001"))
    if first is None or second is None:
        made.losses.append("'Mix Shader' without two shaders")
        return
    weight = find_input(node, "Fac")
    ior = ior_behind(weight)
    share = reflectance_of_ior(ior) if ior else Inputs(made, node).number("Fac", may_be_texture=True)
    if is_number(share):
        read_both(made, node, (first, second), (1 - share, share), ior)
    elif first.type == "BSDF_TRANSPARENT":
        read_shader(made, second)
        made.alpha = share
    else:
        made.losses.append(f"picture '{share.image.name}' as the share of a mixture (rendered as one half)")
        read_both(made, node, (first, second), (0.5, 0.5))


def read_add(made, node):
    nodes = [found for found in (node_behind(socket) for socket in node.inputs) if found]
    if len(nodes) == 2:
        read_both(made, node, nodes, (1.0, 1.0))
    elif nodes:
        read_shader(made, nodes[0])


def read_both(made, node, nodes, weights, ior=None):
    """The nearest material to the weighted sum of two shaders; `ior`: of a highlight of the second over the
    first, which is how plastic is often built."""
    first, second = (Material(name=made.name, double_sided=made.double_sided, baked=made.baked) for _ in nodes)
    for part, shader in zip((first, second), nodes):
        read_shader(part, shader)
    if ior and second.metallic == 1 and first.metallic == 0 and is_number(first.alpha) and first.alpha > 0:
        first.reflectance, first.roughness = reflectance_of_ior(ior), second.roughness
        mixed = dataclasses.replace(first, losses=first.losses + second.losses)
    else:
        mixed = mixtures.combined(first, second, weights)
        if all(mixtures.is_surface(part) for part in (first, second)):
            labels = " and ".join(f"'{shader.bl_label}'" for shader in nodes)
            mixed.losses.append(f"'{node.bl_label}' of {labels} (rendered as one surface)")
    mixed.losses = made.losses + mixed.losses
    for field in dataclasses.fields(mixed):
        setattr(made, field.name, getattr(mixed, field.name))


def ior_behind(socket):
    """The index of refraction of a 'Fresnel' or 'Layer Weight' node, or None."""
    source = source_of(socket)
    if source is None:
        return None
    if source.node.type == "FRESNEL":
        return max(find_input(source.node, "IOR").default_value, 1.0)
    if source.node.type == "LAYER_WEIGHT" and source.name == "Fresnel":
        return 1 / max(1 - find_input(source.node, "Blend").default_value, 1e-5)
    return None


SHADERS = {
    "BSDF_PRINCIPLED": read_principled,
    "BSDF_DIFFUSE": read_diffuse,
    "BSDF_GLOSSY": read_glossy,
    "BSDF_GLASS": read_glass,
    "EMISSION": read_emission,
    "BSDF_TRANSPARENT": read_transparent,
    "MIX_SHADER": read_mix,
    "ADD_SHADER": read_add,
}


def read_normal(made, socket):
    node = node_behind(socket) if socket is not None else None
    if node is None:
        return
    texture = texture_behind(made, find_input(node, "Color"), "RGB") if node.type == "NORMAL_MAP" else None
    if texture is None or node.space != "TANGENT":
        image = made.baked(socket.node.name, socket.identifier, "NORMAL")
        if image is None:
            made.losses.append(f"'{node.bl_label}' at Normal")
        else:
            made.normal = Texture(image)
        return
    uv_map = node.uv_map
    if uv_map and uv_map != texture.uv_map:
        made.losses.append("'Normal Map' with tangents of another UV map")
    made.normal, made.normal_strength = texture, find_input(node, "Strength").default_value


class Inputs:
    """Values of a node's inputs; what cannot be carried is listed, and the input's own value taken."""

    def __init__(self, made, node, find=find_input):
        self.made, self.node, self.find = made, node, find

    def color(self, name, may_be_texture=True):
        return self.color_of(self.find(self.node, name), may_be_texture)

    def color_of(self, socket, may_be_texture=True):
        return self.carried(socket, "RGB", lambda value: tuple(float(channel) for channel in value[:3]),
                            may_be_texture)

    def number(self, name, may_be_texture=False):
        socket = self.find(self.node, name)
        return self.carried(socket, "R", float, may_be_texture) if socket is not None else 0.0

    def carried(self, socket, channels, convert, may_be_texture):
        if not socket.is_linked:
            return convert(socket.default_value)
        constant = constant_behind(socket)
        if constant is not None:
            if channels == "RGB" and is_number(constant):
                return (float(constant),) * 3
            return convert(constant) if channels == "RGB" or is_number(constant) else float(constant[0])
        texture = texture_behind(self.made, socket, channels) if may_be_texture else None
        if texture is not None:
            return texture
        if may_be_texture:
            image = self.made.baked(self.node.name, socket.identifier, "COLOR")
            if image is not None:
                return Texture(image, channels)
        source = node_behind(socket)
        self.made.losses.append(
            f"'{source.bl_label}' at {socket.name}" if source else f"link at {socket.name}")
        return convert(socket.default_value)


def is_smooth(roughness):
    return is_number(roughness) and roughness <= SMOOTH


def has_value(socket, value):
    """Whether nothing is linked to an input and it has this number or colour; None: any."""
    if socket.is_linked:
        return False
    if value is None:
        return True
    return socket.default_value == value if is_number(value) else tuple(
        socket.default_value[:len(value)]) == value


def constant_behind(socket):
    """The value of a node of a constant behind a link; None if it is none."""
    source = source_of(socket)
    return source.default_value if source is not None and source.node.type in ("RGB", "VALUE") else None


def texture_behind(made, socket, channels):
    """The picture behind a link, or None."""
    source = source_of(socket)
    if source is None:
        return None
    node = source.node
    if node.type in ("SEPARATE_COLOR", "SEPRGB"):
        if node.type == "SEPARATE_COLOR" and node.mode != "RGB":
            return None
        whole = texture_behind(made, node.inputs[0], "RGB")
        channel = source.name[0].upper()
        return dataclasses.replace(whole, channels=channel) if whole and channels != "RGB" else None
    if node.type != "TEX_IMAGE" or node.image is None or node.image.source not in ("FILE", "GENERATED"):
        return None
    if source.name == "Alpha":
        if channels == "RGB":
            return None
        channels = "A"
    coordinates = coordinates_behind(find_input(node, "Vector"))
    if coordinates is None or node.projection != "FLAT":
        made.losses.append(f"texture coordinates of '{node.image.name}' other than UV")
        coordinates = ("", ())
    if node.extension == "CLIP":
        made.losses.append(f"'Clip' of '{node.image.name}'")
    return Texture(node.image, channels, *coordinates, extension=node.extension)


def coordinates_behind(socket):
    """(UV map, transform), or None if they are something else."""
    source = source_of(socket)
    if source is None or (source.node.type == "TEX_COORD" and source.name == "UV"):
        return "", ()
    node = source.node
    if node.type == "UVMAP":
        return node.uv_map, ()
    if node.type != "MAPPING" or node.vector_type != "POINT":
        return None
    vector = find_input(node, "Vector")
    below = coordinates_behind(vector)
    values = [find_input(node, name) for name in ("Location", "Rotation", "Scale")]
    if below is None or below[1] or any(value.is_linked for value in values) or not vector.is_linked:
        return None
    place, angle, scale = (value.default_value for value in values)
    if angle[0] or angle[1]:
        return None
    return below[0], tuple(map(float, (place[0], place[1], angle[2], scale[0], scale[1])))


def reflectance_of_ior(ior):
    return ((ior - 1) / (ior + 1)) ** 2


def gltf_anisotropy(roughness, anisotropy):
    """(roughness, strength) of glTF whose lobe has the two widths of Principled's: roughness^2 divided by an
    aspect along the tangent, and times it across."""
    aspect = math.sqrt(1 - 0.9 * min(max(anisotropy, 0.0), 1.0))
    along, across = min(roughness**2 / aspect, 1.0), roughness**2 * aspect
    return math.sqrt(across), math.sqrt((along - across) / (1 - across)) if across < 1 else 0.0


def ior_of_reflectance(reflectance):
    """The index of refraction with this reflectance at normal incidence."""
    root = math.sqrt(min(reflectance, 0.99))
    return (1 + root) / (1 - root)
