#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/layered_image.h"
#include "worker/render/lights/cell_distributions.h"
#include "worker/scene/vec.h"

namespace lumifold::render {

/// A sampled direction towards the environment and its radiance.
struct EnvironmentSample {
  scene::Vec3 direction;  // unit
  scene::Vec3 radiance;
  float pdf = 0;  // per steradian; 0: no sample
};

/// An infinite area light given by a latitude-longitude picture. Its middle column lies at +X, a quarter of
/// its width to the right at +Z, its upper edge at +Y. The rotation then turns it counter-clockwise as seen
/// from above (+X goes towards -Z). Lookup is bilinear, also across the seam. Directions are sampled in
/// proportion to each texel's mean luminance times its solid angle, uniformly within a texel.
/// Threads: safe concurrently. Source: Pharr, Jakob & Humphreys 2023, 12.5.
class Environment {
 public:
  /// `picture` holds R, G, B. Errors: kInvalidArgument if it is empty or black, or the rotation or scale is
  /// not finite, or the scale is not above 0.
  static absl::StatusOr<std::shared_ptr<const Environment>> Create(const LayeredImage& picture,
                                                                   float rotate_degrees, float scale);

  scene::Vec3 Radiance(scene::Vec3 direction) const;

  EnvironmentSample Sample(scene::Vec2 u) const;

  /// The density of Sample() for a unit direction, per steradian.
  float Density(scene::Vec3 direction) const;

  /// Integral of the luminance over all directions.
  double Fluence() const { return fluence_; }

  /// Number of texels that are negative or not finite and count as black.
  int64_t bad_texels() const { return bad_texels_; }

  /// Memory of its tables.
  uint64_t bytes() const {
    return (texels_.size() + row_cos_.size()) * sizeof(float) + rows_.bytes() + columns_.bytes();
  }

 private:
  static constexpr size_t kChannels = 3;

  struct TexelPoint {
    float x;  // in texels from the left edge
    float y;
  };

  Environment(const LayeredImage& picture, float rotate_degrees, float scale);

  void ReadTexels(const LayeredImage& picture, float scale);
  void BuildDistribution();
  std::vector<float> CellLuminances() const;
  size_t TexelIndex(int column, int row) const {
    return kChannels * (static_cast<size_t>(row) * static_cast<size_t>(width_) + static_cast<size_t>(column));
  }
  TexelPoint PointOf(scene::Vec3 direction) const;
  scene::Vec3 Interpolate(TexelPoint point) const;
  float CellDensity(int column, int row) const;

  int width_;
  int height_;
  float sin_turn_ = 0;
  float cos_turn_ = 1;
  double fluence_ = 0;
  int64_t bad_texels_ = 0;
  std::vector<float> texels_;  // radiance, scaled: three channels each, and one number that is read past them
  std::vector<float> row_cos_;  // height + 1: cosine of the angle to +Y at the rows' edges, from the top
  CellDistributions rows_;      // one
  CellDistributions columns_;   // one for each row
};

}  // namespace lumifold::render
