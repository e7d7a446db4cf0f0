#include "server/scheduler/free_units.h"

#include <cstddef>

namespace lumifold::scheduler {

void FreeUnits::Advance(const JobUnits& units, const JobFrames& frames) {
  for (; next_.frame < units.frames().count(); next_ = {next_.frame + 1, 0}) {
    if (frames.IsOver(next_.frame) || passed_.contains(next_.frame)) continue;
    const FrameState* frame = frames.Find(next_.frame);
    if (frame == nullptr) break;
    while (next_.number < units.ordered() && frame->taken[static_cast<size_t>(next_.number)]) ++next_.number;
    if (next_.number < units.ordered()) break;
  }
}

}  // namespace lumifold::scheduler
