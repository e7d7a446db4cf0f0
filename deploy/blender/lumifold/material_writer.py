"""Writes materials into a glTF file."""

import math

from . import materials
from .materials import Texture
from .versions import WHITE

THICKNESS = 1  # any value above 0 makes a mesh of glass a solid, as it is in Blender


class MaterialWriter:
    def __init__(self, builder, files, bakes):
        self.builder, self.files, self.bakes = builder, files, bakes
        self.translated, self.indices = {}, {}

    def translate(self, thing, material):
        """The material as it is on an object: baked pictures belong to one."""
        key = material.name, thing.name if self.bakes.has_any(thing, material) else ""
        if key not in self.translated:
            self.translated[key] = materials.translate(material, self.bakes.of(thing, material))
        return key, self.translated[key]

    def vertex_colors(self, thing, material):
        """The colour attribute of meshes that a material wants, "" for that of rendering, or None."""
        return None if material is None else self.translate(thing, material)[1].vertex_colors

    def index(self, thing, material, uv_names):
        """Index in the file of a material on an object with these UV maps; None for no material."""
        if material is None:
            return None
        name, made = self.translate(thing, material)
        key = (name, uv_names)
        if key not in self.indices:
            self.indices[key] = self.builder.append("materials", self.write(made, uv_names))
        return self.indices[key]

    def write(self, made, uv_names):
        def info(texture, image):
            return self.files.info(texture, image, uv_names)

        surface = {"metallicFactor": factor(made.metallic), "roughnessFactor": factor(made.roughness)}
        written = {"name": made.name, "doubleSided": made.double_sided, "pbrMetallicRoughness": surface}
        self.write_base(made, surface, written, info)
        rough = [one for one in (made.roughness, made.metallic) if isinstance(one, Texture)]
        if rough:
            channels = (one if isinstance(one, Texture) else 1.0 for one in (made.roughness, made.metallic))
            surface["metallicRoughnessTexture"] = info(rough[0], self.files.data(0.0, *channels))
        if made.normal:
            written["normalTexture"] = {
                **info(made.normal, self.files.normal(made.normal)), "scale": made.normal_strength
            }
        extensions = written.setdefault("extensions", {})
        self.write_emission(made, written, extensions, info)
        self.write_specular(made, extensions)
        if made.transmission != 0:
            extensions["KHR_materials_transmission"] = {"transmissionFactor": factor(made.transmission)}
            if not made.is_thin:
                extensions["KHR_materials_volume"] = {"thicknessFactor": THICKNESS}
            if isinstance(made.transmission, Texture):
                image = self.files.data(made.transmission, 0.0, 0.0)
                extensions["KHR_materials_transmission"]["transmissionTexture"] = info(
                    made.transmission, image)
        if made.clearcoat:
            extensions["KHR_materials_clearcoat"] = {
                "clearcoatFactor": made.clearcoat,
                "clearcoatRoughnessFactor": made.clearcoat_roughness,
            }
        if made.anisotropy > 0:
            surface["roughnessFactor"], strength = materials.gltf_anisotropy(made.roughness, made.anisotropy)
            extensions["KHR_materials_anisotropy"] = {
                "anisotropyStrength": strength,
                "anisotropyRotation": 2 * math.pi * made.anisotropy_rotation
            }
        if any(made.sheen_color):
            extensions["KHR_materials_sheen"] = {
                "sheenColorFactor": clamped(made.sheen_color),
                "sheenRoughnessFactor": made.sheen_roughness,
            }
        for name in extensions:
            self.builder.use(name)
        return written

    def write_base(self, made, surface, written, info):
        color = made.base_color
        alpha = made.alpha if isinstance(made.alpha, Texture) else None
        if isinstance(color, Texture):
            surface["baseColorTexture"] = info(color, self.files.color(color, alpha))
        elif alpha:
            surface["baseColorTexture"] = info(alpha, self.files.data(1.0, 1.0, 1.0, alpha))
        if not isinstance(color, Texture) or alpha is None:
            rgb = [color.factor] * 3 if isinstance(color, Texture) else clamped(color)
            surface["baseColorFactor"] = [*rgb, 1.0 if alpha else min(max(made.alpha, 0.0), 1.0)]
        if alpha or made.alpha < 1:
            written["alphaMode"] = "BLEND"  # Cycles blends always, whatever the mode of the viewport

    def write_emission(self, made, written, extensions, info):
        strength = made.emission_strength
        if strength <= 0:
            return
        if isinstance(made.emission, Texture):
            written["emissiveTexture"] = info(made.emission, self.files.color(made.emission))
            written["emissiveFactor"] = list(WHITE)
        else:
            brightest = max(made.emission)
            if brightest <= 0:
                return
            written["emissiveFactor"] = [max(channel / brightest, 0) for channel in made.emission]
            strength *= brightest
        extensions["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}

    @staticmethod
    def write_specular(made, extensions):
        if made.transmission != 0:
            extensions["KHR_materials_ior"] = {"ior": max(made.ior, 1.0)}
        elif made.reflectance > 0:
            extensions["KHR_materials_ior"] = {"ior": materials.ior_of_reflectance(made.reflectance)}
        else:
            extensions["KHR_materials_specular"] = {"specularFactor": 0.0}


def factor(value):
    return 1.0 if isinstance(value, Texture) else min(max(value, 0.0), 1.0)


def clamped(color):
    return [min(max(channel, 0.0), 1.0) for channel in color]
