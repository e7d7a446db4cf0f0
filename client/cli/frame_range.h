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

/// Parses "7", "1-48" or "1-48,60,70-72".
/// Errors: kInvalidArgument with the expected format, for other text, for a last frame before the first and
/// for ranges that are not ascending.
absl::StatusOr<Frames> ParseFrames(absl::string_view text);

/// Whether the file name contains a placeholder for the frame number: one or more #.
bool HasFrameNumber(const std::string& path);

/// Path of a frame's file: the last run of # in the file name is replaced by the frame number, padded with
/// zeros to the length of the run; a longer number is not cut. A name without # and the folder are not
/// changed.
std::string PathOfFrame(const std::string& path, int frame);

}  // namespace lumifold::client
