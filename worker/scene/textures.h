#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/scene/document.h"

namespace lumifold::scene {

/// Brings textures of the document into a Scene when they are first asked for, so that what no material uses
/// is never decoded.
class TextureTable {
 public:
  /// All arguments must outlive the table.
  TextureTable(const Document& document, const AssetReader& reader, const LoadLimits& limits, Scene* scene,
               Diagnostics* diagnostics);

  /// The Scene's index of glTF texture `index`; kNone where its picture is in a format that is not supported.
  /// Errors: kInvalidArgument, kResourceExhausted, the reader's own; all name the texture or image.
  absl::StatusOr<int> Use(int index);

 private:
  absl::StatusOr<int> UseImage(int index);
  absl::StatusOr<ImageData> Decode(const ImageSource& source);

  const Document& document_;
  const AssetReader& reader_;
  Scene* scene_;
  Diagnostics* diagnostics_;
  int64_t pixels_left_;
  std::vector<int> textures_;  // glTF index -> Scene's, kNotRead before
  std::vector<int> images_;
};

}  // namespace lumifold::scene
