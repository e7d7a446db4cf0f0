// Frames with adaptive sampling: the units of their first rounds are leased in order, those of later rounds
// become free when they are decided.
#include <algorithm>
#include <utility>

#include "server/scheduler/scheduler.h"

namespace lumifold::scheduler {

using job::FrameRounds;
using job::JobId;
using job::UnitKey;
using job::UnitRef;

bool Scheduler::SetRounds(const JobId& id, int32_t frame_number, std::shared_ptr<const FrameRounds> rounds) {
  Job* job = FindJob(id);
  if (job == nullptr || job->first_rounds == nullptr) return false;
  const std::optional<int> index = job->frame_list.IndexOf(frame_number);
  if (!index.has_value() || job->finished[static_cast<size_t>(*index)]) return false;
  Frame& frame = ActiveFrame(*job, *index);
  const int before = std::exchange(frame.rounds, std::move(rounds))->count();
  for (int round = before; round < frame.rounds->count(); ++round) {
    int64_t& left = frame.left.emplace_back(0);
    for (int32_t rank = 0; rank < job->units.tiles().count(); ++rank) {
      const UnitKey key = {frame_number, job->units.tiles().TileOfRank(rank), round, v1::UNIT_KIND_PASS};
      if (!frame.rounds->Has(key)) continue;
      ++left;
      job->returned.insert({*index, *job->units.NumberOf(key)});
    }
    job->later_units += left;
  }
  UpdateReady(jobs_by_id_.at(id), *job);
  return UpdateCommitted(*job, *index);
}

std::shared_ptr<const FrameRounds> Scheduler::RoundsOf(const JobId& id, int32_t frame_number) const {
  if (!HasJob(id)) return nullptr;
  const Job& job = GetJob(id);
  const std::optional<int> index = job.frame_list.IndexOf(frame_number);
  const auto frame = index.has_value() ? job.frames.find(*index) : job.frames.end();
  return frame == job.frames.end() ? nullptr : frame->second.rounds;
}

int Scheduler::CommittedRounds(const JobId& id, int32_t frame_number) const {
  if (RoundsOf(id, frame_number) == nullptr) return 0;
  const Job& job = GetJob(id);
  const std::vector<int64_t>& left = job.frames.at(*job.frame_list.IndexOf(frame_number)).left;
  const auto first = std::find_if(left.begin(), left.end(), [](int64_t units) { return units > 0; });
  return std::max(0, static_cast<int>(first - left.begin()) - 1);
}

TileSamples Scheduler::SamplesOf(const UnitRef& unit) const {
  const UnitIndex index = IndexOf(unit).value();
  return SamplesOf(jobs_.at(index.job), index.place);
}

TileSamples Scheduler::SamplesOf(const Job& job, const Place& place) {
  const UnitKey key = job.units.KeyOf(job.frame_list.NumberOf(place.frame), place.number);
  if (job.first_rounds == nullptr) return job.units.SamplesOf(key);
  return job.frames.at(place.frame).rounds->SamplesOf(key);
}

int64_t Scheduler::CameraSamplesOf(const Job& job, const Place& place) {
  const UnitKey key = job.units.KeyOf(job.frame_list.NumberOf(place.frame), place.number);
  if (job.first_rounds == nullptr) return job.units.CameraSamplesOf(key);
  return job.frames.at(place.frame).rounds->CameraSamplesOf(key);
}

bool Scheduler::IsFrameComplete(const Job& job, const Frame& frame) {
  if (frame.rounds == nullptr) return frame.committed == job.units.count();
  return frame.rounds->is_final() &&
         std::all_of(frame.left.begin(), frame.left.end(), [](int64_t units) { return units == 0; });
}

int64_t Scheduler::UnitsTotal(const Job& job) {
  return job.ordered_units() * job.frame_list.count() + job.later_units;
}

}  // namespace lumifold::scheduler
