#pragma once

#include <optional>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/scene/document.h"

namespace lumifold::scene {

/// Adds textures of the document to a Scene on first use, so that a texture without a material is never
/// decoded; their pictures are decoded at the end, side by side.
class TextureTable {
 public:
  /// All arguments must outlive the table.
  TextureTable(const Document& document, const LoadOptions& options, Scene* scene, Diagnostics* diagnostics);

  /// The Scene's index of glTF texture `index`; kNone if its picture has an unsupported format.
  /// Errors: kInvalidArgument, naming the texture or image.
  absl::StatusOr<int> Use(int index);

  /// The Scene's index of a texture whose green is the roughness 1 - `glossiness` * alpha of the Scene's
  /// texture `texture`, and whose blue is 0.
  int RoughnessOfGlossiness(int texture, float glossiness);

  /// Decodes the pictures of the textures in use. Files are read one at a time. Errors: kInvalidArgument,
  /// kResourceExhausted, the reader's own; all name the image, the first of several.
  absl::Status DecodeImages(const AssetReader& reader);

 private:
  /// A picture of the Scene: an image of the document, or what is made of it.
  struct Source {
    int image = kNone;
    std::optional<float> glossiness;  // set: the roughness of its alpha
  };

  absl::StatusOr<int> UseImage(int index);
  absl::StatusOr<SharedImage> DecodeFile(std::string_view file) const;
  absl::StatusOr<SharedImage> Decode(const Source& source, const AssetReader& one_at_a_time) const;
  absl::StatusOr<SharedImage> DecodeSource(const ImageSource& source, const AssetReader& one_at_a_time) const;

  const Document& document_;
  const LoadOptions& options_;
  Scene* scene_;
  Diagnostics* diagnostics_;
  std::vector<int> textures_;  // glTF index -> Scene's index, or kNotRead
  std::vector<int> images_;
  std::vector<Source> sources_;  // of the Scene's images
};

}  // namespace lumifold::scene
