#include "server/scheduler/job_frames.h"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>

#include "filter/image/check.h"

namespace lumifold::scheduler {

using job::FrameRounds;
using job::UnitKey;

namespace {

/// Index in FrameState::left.
size_t RoundIndexOf(const UnitKey& key) {
  return key.kind == v1::UNIT_KIND_GEOMETRY ? 0 : static_cast<size_t>(1 + key.pass);
}

}  // namespace

FrameState* JobFrames::Find(int frame) {
  const auto found = active_.find(frame);
  return found == active_.end() ? nullptr : &found->second;
}

const FrameState* JobFrames::Find(int frame) const {
  const auto found = active_.find(frame);
  return found == active_.end() ? nullptr : &found->second;
}

FrameState& JobFrames::Open(int frame, const JobUnits& units) {
  const auto [it, is_new] = active_.try_emplace(frame);
  LUMIFOLD_CHECK(is_new && !IsOver(frame));
  FrameState& state = it->second;
  state.taken.resize(static_cast<size_t>(units.of_frame().count()));
  state.deliverers.resize(static_cast<size_t>(units.of_frame().count()));
  state.rounds = units.first_rounds();
  if (state.rounds != nullptr)
    state.left.assign(static_cast<size_t>(state.rounds->count()) + 1, units.of_frame().tiles().count());
  return state;
}

void JobFrames::Finish(int frame) {
  LUMIFOLD_CHECK(active_.erase(frame) == 1);
  committed_.erase(frame);
  over_[static_cast<size_t>(frame)] = true;
  ++finished_count_;
}

void JobFrames::Skip(int frame) {
  LUMIFOLD_CHECK(!IsActive(frame) && !IsOver(frame));
  over_[static_cast<size_t>(frame)] = true;
  ++skipped_count_;
}

void JobFrames::RestoreFinished(int frame, const JobUnits& units) {
  LUMIFOLD_CHECK(!IsActive(frame));  // finished frames are restored first
  if (IsOver(frame)) return;
  over_[static_cast<size_t>(frame)] = true;
  ++finished_count_;
  committed_units_ += units.ordered();
  const v1::JobSpec& spec = units.spec();
  committed_samples_ += int64_t{spec.width()} * spec.height() * spec.samples_per_pixel();
}

std::vector<Place> JobFrames::SetRounds(int frame, std::shared_ptr<const FrameRounds> rounds,
                                        const JobUnits& units) {
  FrameState& state = active_.at(frame);
  const job::TileGrid& tiles = units.of_frame().tiles();
  const int before = std::exchange(state.rounds, std::move(rounds))->count();
  std::vector<Place> added;
  for (int round = before; round < state.rounds->count(); ++round) {
    int64_t& left = state.left.emplace_back(0);
    for (int32_t rank = 0; rank < tiles.count(); ++rank) {
      const UnitKey key = {units.frames().NumberOf(frame), tiles.TileOfRank(rank), round, v1::UNIT_KIND_PASS};
      const std::optional<int64_t> number = units.of_frame().NumberOf(key);
      if (!number.has_value() || !state.rounds->Has(key)) continue;
      ++left;
      added.push_back({frame, *number});
    }
  }
  return added;
}

TileSamples JobFrames::SamplesOf(const Place& place, const JobUnits& units) const {
  const UnitKey key = units.KeyOf(place);
  if (units.first_rounds() == nullptr) return units.of_frame().SamplesOf(key);
  return active_.at(place.frame).rounds->SamplesOf(key);
}

bool JobFrames::HasResult(const Place& place) const {
  if (IsOver(place.frame)) return true;
  const FrameState* frame = Find(place.frame);
  return frame != nullptr && frame->taken[static_cast<size_t>(place.number)];
}

void JobFrames::Count(const Place& place, const JobUnits& units, int change) {
  FrameState& frame = active_.at(place.frame);
  const UnitKey key = units.KeyOf(place);
  const bool is_adaptive = frame.rounds != nullptr;
  frame.committed += change;
  if (is_adaptive) frame.left[RoundIndexOf(key)] -= change;
  committed_units_ += change;
  committed_samples_ +=
      change * (is_adaptive ? frame.rounds->CameraSamplesOf(key) : units.of_frame().CameraSamplesOf(key));
}

bool JobFrames::IsComplete(const FrameState& frame, const JobUnits& units) {
  if (frame.rounds == nullptr) return frame.committed == units.of_frame().count();
  return frame.rounds->is_final() &&
         std::all_of(frame.left.begin(), frame.left.end(), [](int64_t left) { return left == 0; });
}

void JobFrames::MarkCommitted(int frame, bool is_committed) {
  if (is_committed) {
    committed_.insert(frame);
  } else {
    committed_.erase(frame);
  }
}

}  // namespace lumifold::scheduler
