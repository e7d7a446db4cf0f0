#pragma once

#include <string>
#include <utility>

#include "tests/scenes/scene_description.h"

namespace lumifold::scenes {

/// A pure Lambert surface.
inline Material Matte(std::string name, Vec3 color) {
  return {.name = std::move(name), .base_color = color, .specular = 0};
}

/// A dielectric with the 4 % highlight that glTF gives every surface, or a `specular` part of it.
inline Material Glossy(std::string name, Vec3 color, double roughness, double specular = 1) {
  return {.name = std::move(name), .base_color = color, .roughness = roughness, .specular = specular};
}

/// Roughness 0 makes a mirror.
inline Material Metal(std::string name, Vec3 color, double roughness) {
  return {.name = std::move(name), .base_color = color, .metallic = 1, .roughness = roughness};
}

/// A thin pane of clear, smooth glass.
inline Material Glass(std::string name) {
  return {.name = std::move(name), .base_color = {1, 1, 1}, .roughness = 0, .transmission = 1};
}

/// Clear, smooth glass that fills its mesh.
inline Material SolidGlass(std::string name) {
  Material glass = Glass(std::move(name));
  glass.is_solid = true;
  return glass;
}

/// An emitter that reflects nothing.
inline Material Emitter(std::string name, Vec3 radiance) {
  return {.name = std::move(name), .base_color = {0, 0, 0}, .specular = 0, .emission = radiance};
}

/// A surface that looks the same in any light.
inline Material Unlit(std::string name, Vec3 color) {
  return {.name = std::move(name), .base_color = color, .unlit = true};
}

/// `material`, its colour multiplied by a texture of which one repeat covers `size_m`.
inline Material Textured(Material material, TextureId texture, Vec2 size_m) {
  material.texture = texture;
  material.texture_size_m = size_m;
  return material;
}

/// For sheets without thickness: cloth, leaves, slats.
inline Material DoubleSided(Material material) {
  material.double_sided = true;
  return material;
}

}  // namespace lumifold::scenes
