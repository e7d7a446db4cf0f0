#include "server/job/frame_rounds.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"

namespace lumifold::job {
namespace {

job::SamplingSettings SettingsOf(const v1::JobSpec& spec) {
  return {.width = spec.width(),
          .height = spec.height(),
          .budget = static_cast<double>(spec.samples_per_pixel()),
          .target_error = spec.adaptive().target_error(),
          .budget_changes = spec.adaptive().time_seconds() > 0 || !spec.adaptive().schedule().empty()};
}

/// What the frame may have from its estimate number `index` on; 0 where that does not change.
double BudgetOf(const v1::AdaptiveSampling& adaptive, size_t index, const v1::RoundEstimate& estimate) {
  if (adaptive.schedule().empty()) return estimate.budget();
  return adaptive.schedule(std::min(static_cast<int>(index), adaptive.schedule_size() - 1));
}

}  // namespace

FrameRounds::FrameRounds(const v1::JobSpec& spec)
    : tiles_(spec.width(), spec.height(), spec.tile_size()), sampling_(SettingsOf(spec)) {}

absl::StatusOr<FrameRounds> FrameRounds::Replay(const v1::JobSpec& spec,
                                                const v1::RoundEstimates& estimates) {
  FrameRounds rounds(spec);
  const int blocks = rounds.sampling_.columns() * rounds.sampling_.rows();
  for (const v1::RoundEstimate& estimate : estimates.estimates()) {
    const int round = rounds.estimated_;
    bool fits = !rounds.is_final() && round < rounds.count() && estimate.errors_size() == blocks &&
                estimate.costs_size() == blocks;
    for (const double error : estimate.errors()) fits = fits && std::isfinite(error);
    for (const double cost : estimate.costs()) fits = fits && std::isfinite(cost) && cost > 0;
    const double budget = BudgetOf(spec.adaptive(), rounds.schedule_.size(), estimate);
    fits = fits && std::isfinite(estimate.rendered_seconds()) &&
           (budget == 0 || (budget >= 1 && budget <= spec.samples_per_pixel()));
    if (!fits)
      return absl::DataLossError(absl::StrCat("the estimate of round ", round, " does not fit its frame"));
    if (budget > 0) {
      rounds.sampling_.SetBudget(budget);
      rounds.schedule_.push_back(budget);
    }
    rounds.sampling_.AddEstimate(round,
                                 std::vector<double>(estimate.errors().begin(), estimate.errors().end()),
                                 std::vector<double>(estimate.costs().begin(), estimate.costs().end()));
    rounds.rendered_seconds_ = estimate.rendered_seconds();
    ++rounds.estimated_;
  }
  return rounds;
}

bool FrameRounds::Has(const UnitKey& unit) const {
  if (unit.kind == v1::UNIT_KIND_GEOMETRY) return true;
  if (unit.pass < 0 || unit.pass >= count()) return false;
  return CameraSamplesOf(unit) > 0;
}

TileSamples FrameRounds::SamplesOf(const UnitKey& unit) const {
  if (unit.kind == v1::UNIT_KIND_GEOMETRY) return SampleRange{};
  return sampling_.SamplesOf(tiles_.RectOf(unit.tile), static_cast<size_t>(unit.pass));
}

int64_t FrameRounds::CameraSamplesOf(const UnitKey& unit) const {
  const Rect tile = tiles_.RectOf(unit.tile);
  return SamplesOf(unit).CountIn(tile.width(), tile.height());
}

}  // namespace lumifold::job
