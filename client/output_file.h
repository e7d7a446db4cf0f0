#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace lumifold::client {

/// What the last letters of an output's name ask for.
enum class PictureFormat { kExr, kPng };

/// Errors: kInvalidArgument for any name that ends neither in .exr nor in .png, upper case or lower.
absl::StatusOr<PictureFormat> PictureFormatOf(const std::string& path);

/// Checks before any work is done that `path` can be written: its folder is there and lets us write, and it
/// is no folder itself. Errors: kNotFound, kPermissionDenied, kInvalidArgument, naming what is in the way.
absl::Status CheckOutput(const std::string& path);

/// Writes one colour layer of an OpenEXR file as PNG; an empty layer is the finished picture.
/// Errors: those of reading and writing, naming the file; kNotFound for a layer the file does not have.
absl::Status WritePngOfLayer(const std::string& exr_path, const std::string& layer, float exposure,
                             const std::string& png_path);

/// Gives a file the user's name once it is whole. Errors: kInternal with the system's words.
absl::Status MoveIntoPlace(const std::string& from, const std::string& to);

}  // namespace lumifold::client
