#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "filter/denoise/settings.h"

namespace lumifold::filter {

/// What one stage of the method declares about itself: docs/method.md has it as a table.
struct StageInfo {
  std::string_view name;
  std::string_view reads;
  std::string_view writes;
  std::string_view off_when;  // besides being switched off
  std::string_view source;
  std::string_view header;
  /// Radius in pixels of the inputs that a pixel of the output depends on; of a recursive blur, the radius
  /// beyond which an input weighs less than 1/200. Null: 0, the pixel alone.
  int (*window_px)(const Settings&) = nullptr;
  bool is_required = false;  // cannot be switched off
};

/// Radius in pixels beyond which the weight exp(-sqrt(2) d / sigma) of a recursive blur is below 1/200.
int BlurWindow(float sigma_px);

/// A part of the features, or of what they guide, that can be switched off by name like a stage.
struct GuideInfo {
  std::string_view name;
  std::string_view summary;
  void (*turn_off)(Settings*);
};

/// Names of stages and guides that are switched off.
using SwitchedOff = std::vector<std::string>;

/// Told the name of each stage when it has ended; for the stages of a layer, once for each layer.
using StageWatch = std::function<void(std::string_view stage)>;

bool IsOff(const SwitchedOff& off, std::string_view name);

}  // namespace lumifold::filter
