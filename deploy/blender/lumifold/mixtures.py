"""The material of glTF that is nearest to the sum of two. Needs no Blender.

glTF has one surface, of which `metallic` says how much reflects like metal and `transmission` how much lets
light through. Two shaders with weights are therefore one surface: its colour is the sum of both colours, and
what is no colour is the mean, weighted by how much light each of them gives back.
"""

import dataclasses

from .versions import is_number, luminance

HALF = 0.5  # the brightness of a picture, which is not looked at


def combined(first, second, weights):
    """The nearest Material to weights[0] * first + weights[1] * second."""
    opacity = [weight * number_of(one.alpha) for weight, one in zip(weights, (first, second))]
    made = dataclasses.replace(first, alpha=min(sum(opacity), 1.0), losses=first.losses + second.losses)
    weights = [one / max(made.alpha, 1e-6) for one in opacity]
    light = [weight * brightness(one) for weight, one in zip(weights, (first, second))]
    shine = [amount * highlight(one) for amount, one in zip(light, (first, second))]
    made.base_color = color_sum(made, (first.base_color, second.base_color), weights, light)
    for name in ("metallic", "transmission", "reflectance"):
        mean(made, name, first, second, light)
    for name in ("roughness", "anisotropy"):
        mean(made, name, first, second, shine if any(shine) else light)
    through = [amount * number_of(one.transmission) for amount, one in zip(light, (first, second))]
    clearest = first if through[0] >= through[1] else second
    made.ior, made.is_thin = clearest.ior, clearest.is_thin
    add_emission(made, first, second, weights)
    add_layers(made, first, second, weights)
    bumpy = first if first.normal and (light[0] >= light[1] or not second.normal) else second
    made.normal, made.normal_strength = bumpy.normal, bumpy.normal_strength
    made.vertex_colors = first.vertex_colors or second.vertex_colors
    return made


def number_of(value):
    return value if is_number(value) else 1.0


def brightness(material):
    """How much light the surface gives back, roughly."""
    color = material.base_color
    return luminance(color) if isinstance(color, tuple) else HALF * color.factor


def is_surface(material):
    """Whether it gives light back, which one that only shines or lets all through does not."""
    return number_of(material.alpha) * (brightness(material) + number_of(material.transmission)) > 0


def highlight(material):
    return material.reflectance + number_of(material.metallic) + number_of(material.transmission)


def color_sum(made, colors, weights, light):
    if all(isinstance(color, tuple) for color in colors):
        return tuple(min(sum(w * color[i] for w, color in zip(weights, colors)), 1.0) for i in range(3))
    # A picture remains, with the weight of both where the other is a colour that gives light back.
    chosen = 0 if not isinstance(colors[0], tuple) and (isinstance(colors[1], tuple)
                                                        or light[0] >= light[1]) else 1
    if light[1 - chosen] > 0:
        made.losses.append(f"colour beside '{colors[chosen].image.name}' in a mixture")
    return dataclasses.replace(colors[chosen], factor=min(colors[chosen].factor * weights[chosen], 1.0))


def mean(made, name, first, second, amounts):
    """Sets a property to the weighted mean, or to that of the greater amount where one is a picture."""
    values, total = [getattr(one, name) for one in (first, second)], sum(amounts)
    share = amounts[1] / total if total else 0.5
    if is_number(values[0]) and is_number(values[1]):
        setattr(made, name, values[0] + share * (values[1] - values[0]))
    else:
        setattr(made, name, values[share > 0.5])


def add_emission(made, first, second, weights):
    sources = [(one.emission, one.emission_strength * weight)
               for one, weight in zip((first, second), weights)
               if one.emission_strength * weight > 0]
    if len(sources) == 2 and all(isinstance(color, tuple) for color, _ in sources):
        made.emission = tuple(sum(color[i] * strength for color, strength in sources) for i in range(3))
        made.emission_strength = 1.0
    else:
        made.emission, made.emission_strength = max(sources, key=lambda one: one[1],
                                                    default=((0.0, 0.0, 0.0), 0.0))


def add_layers(made, first, second, weights):
    """The coat and the sheen: their weights are added, the stronger one says how rough they are."""
    coats = [one.clearcoat * weight for one, weight in zip((first, second), weights)]
    made.clearcoat = min(sum(coats), 1.0)
    made.clearcoat_roughness = (first if coats[0] >= coats[1] else second).clearcoat_roughness
    made.sheen_color = tuple(
        min(a * weights[0] + b * weights[1], 1.0) for a, b in zip(first.sheen_color, second.sheen_color))
    rougher = first if luminance(first.sheen_color) >= luminance(second.sheen_color) else second
    made.sheen_roughness = rougher.sheen_roughness
