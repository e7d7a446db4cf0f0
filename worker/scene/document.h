#pragma once

#include <deque>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/scene/diagnostics.h"
#include "worker/scene/gltf_loader.h"
#include "worker/scene/rig.h"
#include "worker/scene/tinygltf.h"

namespace lumifold::scene {

/// Where an image's encoded bytes are: in a buffer view, or behind a URI.
struct ImageSource {
  std::string name;
  int view = kNone;
  std::string uri;  // as written in the file
};

/// A glTF document in memory. tinygltf sees its JSON only: buffers and images stay with us, so that a GLB's
/// binary part is never copied, nothing but the AssetReader opens files, and every offset is checked before
/// it is used.
struct Document {
  tinygltf::Model model;                  // without the sections buffers, images, animations and skins
  std::vector<std::string_view> buffers;  // each at least as long as its byteLength said, and cut to that
  std::vector<ImageSource> images;
  std::vector<Animation> animations;
  std::vector<Skin> skins;
  std::deque<std::string> owned;  // what `buffers` points into besides the caller's bytes
};

/// Takes `bytes` (glTF text or GLB; they must outlive the document) apart and reads its external buffers.
/// Errors: kInvalidArgument; the reader's own. Throws what its JSON libraries throw.
absl::StatusOr<Document> ParseDocument(std::string_view bytes, const AssetReader& reader,
                                       Diagnostics* diagnostics);

/// The bytes of buffer view `view`. Errors: kInvalidArgument when it does not exist or leaves its buffer.
absl::StatusOr<std::string_view> ViewBytes(const Document& document, int view);

/// The content behind `uri`: its own when it is a data URI, else what the reader gives.
absl::StatusOr<std::string> ReadUri(const std::string& uri, const AssetReader& reader);

}  // namespace lumifold::scene
