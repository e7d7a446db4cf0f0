#include "client/cli/frame_range.h"

#include <algorithm>
#include <limits>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

namespace lumifold::client {
namespace {

constexpr int kLastFrame = std::numeric_limits<int>::max() - 1;

// Digits only: SimpleAtoi also accepts signs and spaces.
bool ParseFrame(absl::string_view text, int* frame) {
  return std::all_of(text.begin(), text.end(), [](unsigned char c) { return absl::ascii_isdigit(c); }) &&
         absl::SimpleAtoi(text, frame) && *frame <= kLastFrame;
}

bool ParseRange(absl::string_view text, FrameRange* range) {
  const size_t dash = text.find('-');
  if (!ParseFrame(text.substr(0, dash), &range->first)) return false;
  range->last = range->first;
  if (dash != absl::string_view::npos && !ParseFrame(text.substr(dash + 1), &range->last)) return false;
  return range->first <= range->last;
}

}  // namespace

std::string TextOf(const std::vector<FrameRange>& ranges) {
  return absl::StrJoin(ranges, ",", [](std::string* text, const FrameRange& range) {
    absl::StrAppend(text, range.first);
    if (range.last > range.first) absl::StrAppend(text, "-", range.last);
  });
}

bool HasFrame(const std::vector<FrameRange>& ranges, int frame) {
  return std::any_of(ranges.begin(), ranges.end(), [frame](const FrameRange& range) {
    return frame >= range.first && frame <= range.last;
  });
}

void AddFrame(int frame, std::vector<FrameRange>* ranges) {
  if (ranges->empty() || ranges->back().last + 1 != frame) {
    ranges->push_back({frame, frame});
  } else {
    ranges->back().last = frame;
  }
}

absl::StatusOr<Frames> ParseFrames(absl::string_view text) {
  Frames frames{.ranges = {}};
  for (const absl::string_view part : absl::StrSplit(text, ',')) {
    FrameRange range;
    const bool valid = ParseRange(part, &range);
    if (!valid || (!frames.ranges.empty() && range.first <= frames.last())) {
      return absl::InvalidArgumentError(absl::StrCat(
          "expected a frame such as 7 or frames such as 1-48 or 1-48,60 in ascending order; got '", text,
          "'"));
    }
    frames.ranges.push_back(range);
  }
  return frames;
}

bool HasFrameNumber(const std::string& path) { return PathOfFrame(path, 0) != path; }

std::string PathOfFrame(const std::string& path, int frame) {
  const size_t slash = path.rfind('/');
  const size_t name = slash == std::string::npos ? 0 : slash + 1;
  const size_t last = path.rfind('#');
  if (last == std::string::npos || last < name) return path;
  size_t first = last;
  while (first > name && path[first - 1] == '#') --first;
  const int width = static_cast<int>(last - first + 1);
  return absl::StrCat(path.substr(0, first), absl::StrFormat("%0*d", width, frame), path.substr(last + 1));
}

}  // namespace lumifold::client
