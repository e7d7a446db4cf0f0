#include "filter/edges/non_diffuse_pixels.h"

#include <algorithm>

namespace lumifold::filter {

NonDiffusePixels::NonDiffusePixels(const Frame& frame, float max_glossy_albedo)
    : frame_(frame), max_glossy_albedo_(max_glossy_albedo) {}

bool NonDiffusePixels::Contain(int x, int y) const {
  const auto is_glossy = [&](const ConstFloatView& albedo) {
    return !albedo.IsEmpty() && albedo.At(x, y) > max_glossy_albedo_;
  };
  const auto has_samples = [&](const ConstFloatView& count) {
    return !count.IsEmpty() && count.At(x, y) > 0;
  };
  return std::any_of(frame_.glossy_albedo.begin(), frame_.glossy_albedo.end(), is_glossy) ||
         std::any_of(frame_.levels.begin(), frame_.levels.end(), [&](const LevelViews& level) {
           return has_samples(level.samples.a) || has_samples(level.samples.b);
         });
}

}  // namespace lumifold::filter
