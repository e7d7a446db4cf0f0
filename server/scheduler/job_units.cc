#include "server/scheduler/job_units.h"

#include "server/job/plan.h"

namespace lumifold::scheduler {

JobUnits::JobUnits(const v1::JobSpec& spec)
    : spec_(spec), of_frame_(spec), frames_(job::NeedsPlan(spec) ? job::FirstFrameOf(spec) : spec) {
  if (spec.has_adaptive() && !job::NeedsPlan(spec))
    first_rounds_ = std::make_shared<const job::FrameRounds>(spec);
}

int64_t JobUnits::ordered() const {
  return first_rounds_ == nullptr ? of_frame_.count()
                                  : int64_t{of_frame_.tiles().count()} * (1 + first_rounds_->count());
}

std::optional<Place> JobUnits::PlaceOf(const job::UnitKey& key) const {
  const std::optional<int> frame = frames_.IndexOf(key.frame);
  const std::optional<int64_t> number = of_frame_.NumberOf(key);
  if (!frame.has_value() || !number.has_value()) return std::nullopt;
  return Place{*frame, *number};
}

job::UnitKey JobUnits::KeyOf(const Place& place) const {
  return of_frame_.KeyOf(frames_.NumberOf(place.frame), place.number);
}

size_t JobUnits::SizeOf(const Place& place) const {
  const job::UnitKey key = of_frame_.KeyOf(0, place.number);
  if (key.kind == v1::UNIT_KIND_GEOMETRY) return 0;
  return key.pass == 0 && spec_.first_pass_samples() > 0 ? 1 : 2;
}

}  // namespace lumifold::scheduler
