#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace lumifold::client {

/// File format of an output, from the extension of its name.
enum class PictureFormat { kExr, kPng };

/// Errors: kInvalidArgument for a name that ends neither in .exr nor in .png (in any case).
absl::StatusOr<PictureFormat> PictureFormatOf(const std::string& path);

/// Checks that `path` can be written, before any work is done: its folder exists and is writable, and `path`
/// is not a folder.
/// Errors: kNotFound, kPermissionDenied, kInvalidArgument, naming the obstacle.
absl::Status CheckOutput(const std::string& path);

/// Writes one colour layer of an OpenEXR file as PNG; an empty `layer` is the finished picture (R G B).
/// Errors: those of reading and writing, naming the file; kNotFound for a layer the file does not have.
absl::Status WritePngOfLayer(const std::string& exr_path, const std::string& layer, float exposure,
                             const std::string& png_path);

/// Renames a complete file to its final name.
/// Errors: kInternal with the system's message.
absl::Status MoveIntoPlace(const std::string& from, const std::string& to);

}  // namespace lumifold::client
