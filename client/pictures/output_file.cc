#include "client/pictures/output_file.h"

#include <unistd.h>
#include <climits>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "client/cli/exit_code.h"
#include "filter/image/exr_io.h"
#include "filter/image/layers.h"

namespace lumifold::client {
namespace {

/// "'noisy', 'direct'"; the picture itself has no name.
std::string ColorLayersOf(const LayeredImage& image) {
  std::vector<std::string> names;
  for (const LayeredImage::Channel& channel : image.channels()) {
    const absl::string_view name = channel.name;
    const absl::string_view layer = absl::StripSuffix(name, ".R");
    if (layer != name && image.HasColor({layer.data(), layer.size()}))
      names.push_back(absl::StrCat("'", layer, "'"));
  }
  if (image.HasColor("")) names.insert(names.begin(), "the picture itself");
  return names.empty() ? "none" : absl::StrJoin(names, ", ");
}

}  // namespace

absl::StatusOr<PictureFormat> PictureFormatOf(const std::string& path) {
  if (absl::EndsWithIgnoreCase(path, ".exr")) return PictureFormat::kExr;
  if (absl::EndsWithIgnoreCase(path, ".png")) return PictureFormat::kPng;
  if (absl::EndsWithIgnoreCase(path, ".jpg") || absl::EndsWithIgnoreCase(path, ".jpeg"))
    return PictureFormat::kJpeg;
  return absl::InvalidArgumentError(
      absl::StrCat("expected a name that ends in .exr, .png or .jpg; got '", path, "'"));
}

absl::Status CheckFolder(const std::string& path, const std::string& folder_of_path) {
  std::error_code ignored;
  const std::filesystem::path folder = folder_of_path.empty() ? "." : folder_of_path;
  if (!std::filesystem::exists(folder, ignored)) {
    return absl::NotFoundError(
        absl::StrCat("cannot write ", path, ": folder ", folder.string(), " does not exist"));
  }
  if (!std::filesystem::is_directory(folder, ignored)) {
    return absl::InvalidArgumentError(
        absl::StrCat("cannot write ", path, ": ", folder.string(), " is not a folder"));
  }
  if (access(folder.c_str(), W_OK | X_OK) != 0) {
    return absl::PermissionDeniedError(
        absl::StrCat("cannot write ", path, ": folder ", folder.string(), ": ", std::strerror(errno)));
  }
  return absl::OkStatus();
}

absl::Status CheckOutput(const std::string& path) {
  if (absl::Status status = CheckFolder(path, std::filesystem::path(path).parent_path().string());
      !status.ok())
    return status;
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored))
    return absl::InvalidArgumentError(absl::StrCat("cannot write ", path, ": it is a folder"));
  const size_t length = std::filesystem::path(path).filename().string().size();
  if (length > NAME_MAX) {
    return absl::InvalidArgumentError(
        absl::StrCat("cannot write ", path, ": its name has ", length, " bytes, more than ", NAME_MAX));
  }
  return absl::OkStatus();
}

bool IsTransparent(const LayeredImage& image) {
  const auto background = image.metadata().find("lumifold.background");
  return background != image.metadata().end() && background->second == "transparent" &&
         image.Has(layers::kAlpha);
}

absl::Status WriteLayer(const std::string& exr_path, const std::string& layer,
                        const pictures::DisplayOptions& display, const std::string& path) {
  const absl::StatusOr<LayeredImage> image = ReadExr(exr_path);
  if (absl::IsNotFound(image.status())) return image.status();
  if (!image.ok()) return OfThisMachine(image.status());
  if (!image->HasColor(layer)) {
    return absl::NotFoundError(
        absl::StrCat(exr_path, ": has no colour layer '", layer, "'; it has ", ColorLayersOf(*image)));
  }
  if (!IsTransparent(*image) || (!layer.empty() && layer != layers::kNoisy))
    return OfThisMachine(pictures::WriteDisplayed(path, image->GetColor(layer), display));
  const ConstFloatView alpha = image->Get(layers::kAlpha);
  return OfThisMachine(pictures::WriteDisplayed(path, image->GetColor(layer), display, &alpha));
}

}  // namespace lumifold::client
