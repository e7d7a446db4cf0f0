#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace lumifold::client {

/// Frames from `first` to `last`, both among them.
struct FrameRange {
  int first = 0;
  int last = 0;

  int count() const { return last - first + 1; }
  friend bool operator==(const FrameRange&, const FrameRange&) = default;
};

/// Reads "7" or "1-48". Errors: kInvalidArgument that says what is expected, for anything else and for a last
/// frame before the first.
absl::StatusOr<FrameRange> ParseFrameRange(absl::string_view text);

/// Whether the name of the file has a place for the frame's number: a run of #.
bool HasFrameNumber(const std::string& path);

/// The frame's file: the last run of # in the name of the file becomes its number, with zeros before it up to
/// the run's length; a longer number takes the room it needs. A name without # stays as it is, and so does
/// the folder.
std::string PathOfFrame(const std::string& path, int frame);

}  // namespace lumifold::client
