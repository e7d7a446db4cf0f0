#pragma once

#include "filter/layers/frame.h"

namespace lumifold::filter {

/// Pixels whose light D, I, T and E do not hold alone: those that show a level, and those where the albedo of
/// the glossy lobes is above `max_glossy_albedo`. Keeps a reference to the frame.
class NonDiffusePixels {
 public:
  NonDiffusePixels(const Frame& frame, float max_glossy_albedo);

  bool Contain(int x, int y) const;

 private:
  const Frame& frame_;
  float max_glossy_albedo_;
};

}  // namespace lumifold::filter
