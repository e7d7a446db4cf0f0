#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/types/span.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::job {

/// Frames that a job skips, ascending. Of gaps that no job has, at most kMaxFrames.
std::vector<int32_t> SkippedFrames(const v1::Gaps& gaps);
/// Their number; as above.
int CountSkipped(const v1::Gaps& gaps);
/// Whether a frame is among them. O(log ranges).
bool IsSkipped(const v1::Gaps& gaps, int32_t frame);
/// "17,20-22".
std::string TextOf(const v1::Gaps& gaps);
/// Ascending frames as ranges.
void SetSkipped(absl::Span<const int32_t> frames, v1::Gaps* gaps);

/// Whether a job may skip one more frame that cannot be rendered, instead of failing: one that ends with more
/// frames than it lacks, or has met few. It bounds what a job costs whose frames fail one after the other.
bool MaySkipAnother(int skipped, int finished, int frames);

}  // namespace lumifold::job
