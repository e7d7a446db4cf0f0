#pragma once

#include <map>
#include <optional>
#include <string>

#include "absl/status/status.h"

namespace lumifold {

/// What a copy of an OpenEXR file has of its own.
struct ExrCopyOptions {
  /// "none", "zips", "zip", "piz" or "dwaa"; empty: as it is. DWAA loses a little of the colours, which it
  /// keeps in 16 bits; it is used for them alone, so that normals, numbers of objects and Cryptomatte stay
  /// what they are: the copy then has a part for each layer.
  std::string compression = {};
  /// Each layer becomes a part of that name, with the channels R, G, B or X, Y, Z; the picture itself is the
  /// part "rgba".
  bool layers_as_parts = false;
  /// Only what compositors use: the picture, albedo, emission and normals in halves, depth and numbers of
  /// objects in floats, and Cryptomatte. Light beyond the largest half (65504) becomes that.
  bool is_lean = false;
  /// Added to those of the file, or in their place.
  std::map<std::string, std::string> texts = {};
  std::map<std::string, float> numbers = {};
};

/// Copies a file of this library to `to`, some rows at a time; where the compression stays, without decoding.
/// The copy is written atomically.
/// Errors: as ReadExr; kUnavailable if the copy cannot be written.
absl::Status CopyExr(const std::string& from, const std::string& to, const ExrCopyOptions& options);

}  // namespace lumifold
