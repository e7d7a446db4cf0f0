#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/layered_image.h"
#include "worker/scene/vec.h"

namespace lumifold::render {

/// A direction drawn towards the sky, and what comes from there.
struct SkySample {
  scene::Vec3 direction;  // unit
  scene::Vec3 radiance;
  float pdf = 0;  // per steradian; 0: nothing was drawn
};

/// Light from all round, infinitely far away: a latitude-longitude picture. Its middle column lies at +X, a
/// quarter of its width to the right at +Z, its upper edge at +Y; it is then turned by the rotation, counter-
/// clockwise seen from above (+X goes towards -Z). Between texels it is bilinear, round the seam as well.
/// Directions are drawn in proportion to each texel's mean luminance times its solid angle, evenly within a
/// texel. Threads: safe concurrently. Source: Pharr, Jakob & Humphreys 2023, 12.5 (piecewise-constant
/// sampling by inverted distributions, which keep well-stratified random numbers well stratified).
class Environment {
 public:
  /// `picture` holds R, G, B. Errors: kInvalidArgument where it is empty or black, or a number is not finite.
  static absl::StatusOr<std::shared_ptr<const Environment>> Create(const LayeredImage& picture,
                                                                   float rotate_degrees, float scale);

  scene::Vec3 Radiance(scene::Vec3 direction) const;

  SkySample Sample(scene::Vec2 u) const;

  /// The density of Sample() at a unit direction, per steradian.
  float Density(scene::Vec3 direction) const;

  /// Integral of the luminance over all directions.
  double Fluence() const { return fluence_; }

  /// Texels that were not finite or negative, and count as black.
  int64_t bad_texels() const { return bad_texels_; }

 private:
  struct TexelPoint {
    float x;  // in texels from the left edge
    float y;
  };

  Environment(const LayeredImage& picture, float rotate_degrees, float scale);

  void ReadTexels(const LayeredImage& picture, float scale);
  void BuildDistribution();
  std::vector<float> CellLuminances() const;
  TexelPoint PointOf(scene::Vec3 direction) const;
  scene::Vec3 Interpolate(TexelPoint point) const;
  float CellDensity(int column, int row) const;

  int width_;
  int height_;
  float sin_turn_ = 0;
  float cos_turn_ = 1;
  double fluence_ = 0;
  int64_t bad_texels_ = 0;
  std::vector<scene::Vec3> texels_;  // radiance, scaled
  std::vector<float> row_cos_;  // cosine of the angle to +Y at each row's upper edge, and at the last's lower
  std::vector<float> row_cdf_;  // height + 1
  std::vector<float> column_cdf_;  // width + 1 for each row
};

}  // namespace lumifold::render
