#pragma once

#include <deque>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/scene/diagnostics.h"
#include "worker/scene/gltf_loader.h"
#include "worker/scene/rig.h"
#include "worker/scene/tinygltf.h"

namespace lumifold::scene {

/// The location of an image's encoded bytes: a buffer view or a URI.
struct ImageSource {
  std::string name;
  int view = kNone;
  std::string uri;  // as written in the file
};

/// A glTF document in memory. tinygltf parses the JSON only. Buffers and images are handled here, so that a
/// GLB's binary part is never copied, only the AssetReader opens files, and every offset is checked before
/// use.
struct Document {
  tinygltf::Model model;                  // without the sections buffers, images, animations and skins
  std::vector<std::string_view> buffers;  // each exactly byteLength long; empty if a fallback
  std::map<int, std::string_view> decoded_views;  // the content of compressed buffer views
  std::vector<ImageSource> images;
  std::vector<Animation> animations;
  std::vector<Skin> skins;
  std::string animated_json;      // of a document with pointed properties: what `model` was made of
  std::deque<std::string> owned;  // bytes that `buffers` refers to besides the caller's
};

/// Parses `bytes` (glTF text or GLB; they must outlive the document) and reads the external buffers. Errors:
/// kInvalidArgument; the reader's own. Passes on exceptions of its JSON libraries.
absl::StatusOr<Document> ParseDocument(std::string_view bytes, const AssetReader& reader,
                                       Diagnostics* diagnostics);

/// The values of a property that FindPointer() knows.
struct PointedValue {
  std::string pointer;
  std::vector<float> values;
};

/// Sets properties of the model. Poses of nodes stay as they are. Errors: those of SetPointed;
/// kInvalidArgument if the values are not glTF's. Passes on exceptions of its JSON libraries.
absl::Status SetPointedValues(const std::vector<PointedValue>& values, Document* document);

/// The bytes of buffer view `view`. Errors: kInvalidArgument if it does not exist or exceeds its buffer.
absl::StatusOr<std::string_view> ViewBytes(const Document& document, int view);

/// The content of `uri`: decoded if it is a data URI, else read by `reader`.
absl::StatusOr<std::string> ReadUri(const std::string& uri, const AssetReader& reader);

}  // namespace lumifold::scene
