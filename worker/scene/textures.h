#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/scene/document.h"

namespace lumifold::scene {

/// Adds textures of the document to a Scene on first use, so that a texture without a material is never
/// decoded.
class TextureTable {
 public:
  /// All arguments must outlive the table.
  TextureTable(const Document& document, const AssetReader& reader, const LoadOptions& options, Scene* scene,
               Diagnostics* diagnostics);

  /// The Scene's index of glTF texture `index`; kNone if its picture has an unsupported format.
  /// Errors: kInvalidArgument, kResourceExhausted, the reader's own; all name the texture or image.
  absl::StatusOr<int> Use(int index);

 private:
  absl::StatusOr<int> UseImage(int index);
  absl::StatusOr<SharedImage> Decode(const ImageSource& source);
  absl::StatusOr<SharedImage> DecodeFile(std::string_view file) const;

  const Document& document_;
  const AssetReader& reader_;
  const ImageDecoder& decode_;
  Scene* scene_;
  Diagnostics* diagnostics_;
  int64_t pixels_left_;
  std::vector<int> textures_;  // glTF index -> Scene's index, or kNotRead
  std::vector<int> images_;
};

}  // namespace lumifold::scene
