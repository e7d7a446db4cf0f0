#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace lumifold::client {

/// Frames from `first` to `last`, inclusive.
struct FrameRange {
  int first = 0;
  int last = 0;

  int count() const { return last - first + 1; }
  friend bool operator==(const FrameRange&, const FrameRange&) = default;
};

/// "7", "1-48" or "1-48,60,70-72"; ParseFrames reads it.
std::string TextOf(const std::vector<FrameRange>& ranges);
bool HasFrame(const std::vector<FrameRange>& ranges, int frame);
/// Adds a frame after the last one.
void AddFrame(int frame, std::vector<FrameRange>* ranges);

/// Frames of a job: at least one range, in ascending order, which do not overlap.
struct Frames {
  std::vector<FrameRange> ranges{{}};

  int first() const { return ranges.front().first; }
  int last() const { return ranges.back().last; }
  bool IsOne() const { return first() == last(); }
  friend bool operator==(const Frames&, const Frames&) = default;
};

/// Parses "7", "1-48", "1-48,60,70-72", "1-100x10" or "1-100:10" (every tenth frame), and negative numbers as
/// in "-5--1".
/// Errors: kInvalidArgument with the expected format, for other text, for a last frame before the first, for
/// ranges that are not ascending, and for more than kMaxFrameRanges ranges; frames that do not follow each
/// other are one each.
absl::StatusOr<Frames> ParseFrames(absl::string_view text);

/// Ranges of a job, at most: as many as a coordinator takes.
inline constexpr size_t kMaxFrameRanges = 1025;

/// Whether the file name contains a placeholder for the frame number: two or more #, or one that ends the
/// name before its extension. Any other # is a part of the name ("chair #3.exr").
bool HasFrameNumber(const std::string& path);

/// Path of a frame's file: the placeholder in the file name (the last one) is replaced by the frame number,
/// padded with zeros to the length of the run; a longer number is not cut. A name without one and the
/// folder are not changed.
std::string PathOfFrame(const std::string& path, int frame);

}  // namespace lumifold::client
