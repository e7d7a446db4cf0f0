#include "client/cli/frame_range.h"

#include <algorithm>
#include <limits>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

namespace lumifold::client {
namespace {

constexpr int kLastFrame = std::numeric_limits<int>::max() - 1;

/// Takes a number, which may be negative, from the front of `text`.
bool TakeFrame(absl::string_view* text, int* frame) {
  size_t length = absl::StartsWith(*text, "-") ? 1 : 0;
  while (length < text->size() && absl::ascii_isdigit(static_cast<unsigned char>((*text)[length]))) ++length;
  const bool is_number = absl::SimpleAtoi(text->substr(0, length), frame);
  text->remove_prefix(length);
  return is_number && *frame <= kLastFrame && *frame >= -kLastFrame;
}

bool ParseRange(absl::string_view text, FrameRange* range, int* step) {
  *step = 1;
  if (!TakeFrame(&text, &range->first)) return false;
  range->last = range->first;
  if (text.empty()) return true;
  if (!absl::ConsumePrefix(&text, "-") || !TakeFrame(&text, &range->last)) return false;
  const bool has_step = absl::ConsumePrefix(&text, "x") || absl::ConsumePrefix(&text, ":");
  if (has_step && (!TakeFrame(&text, step) || *step < 1)) return false;
  return text.empty() && range->first <= range->last;
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
    int step = 1;
    const bool valid = ParseRange(part, &range, &step);
    if (!valid || (!frames.ranges.empty() && range.first <= frames.last())) {
      return absl::InvalidArgumentError(absl::StrCat(
          "expected frames such as 7, 1-48, 1-48,60 or 1-100x10 in ascending order; got '", text, "'"));
    }
    if (step == 1) {
      frames.ranges.push_back(range);
      continue;
    }
    for (int64_t frame = range.first; frame <= range.last && frames.ranges.size() <= kMaxFrameRanges;
         frame += step)
      frames.ranges.push_back({static_cast<int>(frame), static_cast<int>(frame)});
  }
  if (frames.ranges.size() > kMaxFrameRanges) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text, "' has more than ", kMaxFrameRanges, " ranges: submit it as several jobs"));
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
  const bool ends_the_name = path.find('.', last) == last + 1 || last + 1 == path.size();
  if (first == last && !ends_the_name) return path;
  const int width = static_cast<int>(last - first + 1);
  return absl::StrCat(path.substr(0, first), absl::StrFormat("%0*d", width, frame), path.substr(last + 1));
}

}  // namespace lumifold::client
