#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/pictures/display_file.h"
#include "filter/image/layered_image.h"

namespace lumifold::client {

/// File format of an output, from the extension of its name.
enum class PictureFormat { kExr, kPng, kJpeg };

/// Whether it has 8 bits a channel, for a display.
inline bool IsDisplayed(PictureFormat format) { return format != PictureFormat::kExr; }

/// Errors: kInvalidArgument for a name that does not end in .exr, .png, .jpg or .jpeg (in any case).
absl::StatusOr<PictureFormat> PictureFormatOf(const std::string& path);

/// Checks that `path` can be written to once its folders are made below `folder`, which must exist.
/// Errors: as CheckOutput.
absl::Status CheckFolder(const std::string& path, const std::string& folder);

/// Checks that `path` can be written, before any work is done: its folder exists and is writable, and `path`
/// is not a folder.
/// Errors: kNotFound, kPermissionDenied, kInvalidArgument, naming the obstacle.
absl::Status CheckOutput(const std::string& path);

/// Whether A is the opacity of the picture itself, rendered before a transparent background. Other pictures
/// have A too: the coverage without what is behind. Only channels and metadata are read.
bool IsTransparent(const LayeredImage& image);

/// Writes one colour layer of an OpenEXR file as .png or .jpg; an empty `layer` is the finished picture (R G
/// B). A .png of a picture with a transparent background has an alpha channel.
/// Errors: those of reading and writing, naming the file; kNotFound for a layer the file does not have.
absl::Status WriteLayer(const std::string& exr_path, const std::string& layer,
                        const pictures::DisplayOptions& display, const std::string& path);

}  // namespace lumifold::client
