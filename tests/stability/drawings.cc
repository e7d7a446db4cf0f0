#include "tests/stability/drawings.h"

#include <algorithm>
#include <cmath>

namespace lumifold::stability {
namespace {

constexpr float kWallDistance = 6;
constexpr float kHorizon = 0.2f;
constexpr float kFloorBegins = 0.6f;

/// The position of an object at that distance after the camera has moved, in widths of the picture.
struct Camera {
  float width, height, shift;

  float Right(float u, float distance) const { return u + shift / width * kWallDistance / distance; }
};

Surface Sky(float v) {
  Surface s;
  s.object = 0;
  s.emission = {0.6f - v, 0.8f - v, 1.0f - v};
  return s;
}

Surface Wall(float u, float v) {
  Surface s;
  s.distance = kWallDistance;
  s.albedo = {0.7f, 0.55f, 0.45f};
  s.direct = Gray(0.3f + 0.4f * std::clamp(u, 0.0f, 1.0f));
  s.indirect = {0.25f, 0.2f + 0.1f * v, 0.2f};
  return s;
}

Surface Box(float u) {
  Surface s;
  s.object = 2;
  s.normal = {0.6f, 0, 0.8f};
  s.distance = 4;
  s.albedo = Gray(0.8f);
  s.direct = Gray(0.9f);
  s.indirect = {0.1f, 0.1f, 0.1f + 0.2f * u};
  return s;
}

Surface Pole() {
  Surface s;
  s.object = 3;
  s.normal = {-0.6f, 0, 0.8f};
  s.distance = 2.5f;
  s.albedo = {0.3f, 0.6f, 0.3f};
  s.direct = Gray(0.4f);
  s.indirect = Gray(0.2f);
  return s;
}

Surface Lamp() {
  Surface s;
  s.object = 4;
  s.has_diffuse = false;
  s.distance = kWallDistance - 0.1f;
  s.emission = {3, 2.5f, 2};
  return s;
}

/// A hard and a soft shadow edge across the floor.
float FloorLight(float across, float z) {
  const float hard = across + 0.4f * z;
  if (hard > 0.9f && hard < 1.5f) return 0.02f;
  return 0.9f - 0.8f * std::clamp((across + 1.2f) * 2, 0.0f, 1.0f) * (across < -0.2f ? 1.0f : 0.0f);
}

Surface Floor(float u, float v, bool textured) {
  const float z = 2 / (v - 0.35f);
  const float across = (u - 0.5f) * z / 2;
  Surface s;
  s.object = 5;
  s.normal = {0, 1, 0};
  s.distance = z;
  const int tile = static_cast<int>(std::floor(across * 4)) + static_cast<int>(std::floor(z * 2));
  s.albedo = textured && tile % 2 != 0 ? Triple{0.2f, 0.2f, 0.3f} : Triple{0.8f, 0.75f, 0.7f};
  s.direct = Gray(textured ? FloorLight(across, z) : 0.7f);
  s.indirect = {0.2f, 0.15f, 0.1f};
  return s;
}

}  // namespace

Drawing RoomDrawing(int width, int height, float shift) {
  const Camera camera = {static_cast<float>(width), static_cast<float>(height), shift};
  return [camera](float x, float y) {
    const float v = y / camera.height;
    const auto at = [&](float distance) { return camera.Right(x / camera.width, distance); };
    if (std::abs(at(2.5f) - 0.75f) < 0.012f && v > 0.1f) return Pole();
    if (at(4) > 0.25f && at(4) < 0.45f && v > 0.35f && v < 0.72f) return Box(at(4));
    if (v > kFloorBegins) {
      const float z = 2 / (v - 0.35f);
      return Floor(camera.Right(x / camera.width, z), v, true);
    }
    const float u = at(kWallDistance);
    if (std::abs(u - 0.6f) < 0.03f && std::abs(v - 0.35f) < 0.02f) return Lamp();
    return v < kHorizon ? Sky(v) : Wall(u, v);
  };
}

Drawing FlatRoomDrawing(int width, int height) {
  const Camera camera = {static_cast<float>(width), static_cast<float>(height), 0};
  return [camera](float x, float y) {
    const float u = x / camera.width;
    const float v = y / camera.height;
    return v > kFloorBegins ? Floor(u, v, false) : Wall(u, v);
  };
}

}  // namespace lumifold::stability
