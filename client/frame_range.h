#pragma once

#include <string>

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

/// Parses "7" or "1-48".
/// Errors: kInvalidArgument with the expected format, for other text and for a last frame before the first.
absl::StatusOr<FrameRange> ParseFrameRange(absl::string_view text);

/// Whether the file name contains a placeholder for the frame number: one or more #.
bool HasFrameNumber(const std::string& path);

/// Path of a frame's file: the last run of # in the file name is replaced by the frame number, padded with
/// zeros to the length of the run; a longer number is not cut. A name without # and the folder are not
/// changed.
std::string PathOfFrame(const std::string& path, int frame);

}  // namespace lumifold::client
