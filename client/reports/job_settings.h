#pragma once

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "lumifold/v1/job.pb.h"

namespace lumifold::client {

/// A value of --pixel-filter, and its width where none is given.
struct PixelFilterChoice {
  const char* name;
  v1::PixelFilterKind kind;
  float width;
};
inline constexpr std::array<PixelFilterChoice, 3> kPixelFilters = {{
    {"box", v1::PIXEL_FILTER_KIND_BOX, 1},
    {"gaussian", v1::PIXEL_FILTER_KIND_GAUSSIAN, 2},
    {"blackman-harris", v1::PIXEL_FILTER_KIND_BLACKMAN_HARRIS, 1.5},
}};

/// Values of --target-metric.
inline constexpr char kMse255[] = "mse255";
inline constexpr char kRelMse[] = "relmse";

/// Value of --env for no environment.
inline constexpr char kNoEnvironment[] = "none";
/// Values of --background and --ground.
inline constexpr char kTransparent[] = "transparent";
inline constexpr char kShadow[] = "shadow";

/// The options that a job was submitted with, by their names in job files, but for its scene; of an
/// environment the file's name alone. Empty for a status of ListJobs, which has no settings.
nlohmann::ordered_json SettingsJson(const v1::JobStatus& status);

/// The same as on a command line, but for size, samples and frames.
std::string SettingsText(const v1::JobStatus& status);

}  // namespace lumifold::client
