#include "tests/bench/unit_costs.h"

#include <algorithm>
#include <cmath>

namespace lumifold::sim {
namespace {

/// Units of a tile: geometry and passes.
constexpr int kLayers = 5;

v1::JobSpec SpecOf(const FarmSettings& settings) {
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  const double tiles = static_cast<double>(settings.units) / settings.unit_scale / settings.jobs /
                       settings.frames_per_job / kLayers;
  const int columns = std::max(1, static_cast<int>(std::lround(std::sqrt(tiles))));
  const int rows = std::max(1, static_cast<int>(std::lround(tiles / columns)));
  spec.set_width(columns * 32);
  spec.set_height(rows * 32);
  spec.set_tile_size(32);
  spec.set_samples_per_pixel(64 * (kLayers - 1));
  spec.set_pass_samples(64);
  spec.set_frame_count(settings.frames_per_job);
  return spec;
}

/// A hash of the unit in [-1, 1].
double Variate(int job, const job::UnitKey& key) {
  uint64_t hash = static_cast<uint64_t>(job) * 0x9e3779b97f4a7c15u;
  for (const int32_t part : {key.frame, key.tile, key.pass, static_cast<int32_t>(key.kind)}) {
    hash = (hash ^ static_cast<uint32_t>(part)) * 0xff51afd7ed558ccdu;
    hash ^= hash >> 32;
  }
  return static_cast<double>(hash >> 11) / 4503599627370496.0 - 1;
}

}  // namespace

UnitCosts::UnitCosts(const FarmSettings& settings)
    : spread_(settings.unit_spread), spec_(SpecOf(settings)), units_(spec_) {}

void UnitCosts::AddJob(double mean_seconds) {
  const auto job = static_cast<int>(mean_seconds_.size());
  mean_seconds_.push_back(mean_seconds);
  for (int frame = 0; frame < spec_.frame_count(); ++frame) {
    for (int64_t number = 0; number < units_.count(); ++number) {
      const double seconds = SecondsOf(job, units_.KeyOf(frame, number));
      total_seconds_ += seconds;
      longest_unit_ = std::max(longest_unit_, absl::Seconds(seconds));
    }
  }
}

double UnitCosts::SecondsOf(int job, const job::UnitKey& key) const {
  return mean_seconds_[static_cast<size_t>(job)] * std::pow(spread_, Variate(job, key));
}

}  // namespace lumifold::sim
