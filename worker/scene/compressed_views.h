#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "nlohmann/json_fwd.hpp"

namespace lumifold::scene {

/// A buffer view compressed by EXT_meshopt_compression or KHR_meshopt_compression.
struct CompressedView {
  enum class Mode { kAttributes, kTriangles, kIndices };
  enum class Filter { kIdentity, kOctahedral, kQuaternion, kExponential, kColor };

  int view = 0;
  int64_t buffer = 0;  // where the compressed bytes are
  uint64_t offset = 0;
  uint64_t length = 0;
  uint64_t stride = 0;  // bytes of an element
  uint64_t count = 0;   // elements
  Mode mode = Mode::kAttributes;
  Filter filter = Filter::kIdentity;
};

/// The compressed ones among the glTF array `buffer_views`.
/// Errors: kInvalidArgument, naming the view, for values that the extension forbids.
absl::StatusOr<std::vector<CompressedView>> FindCompressedViews(const nlohmann::json& buffer_views);

/// Whether `buffer` of a glTF document only stands in for compressed views and has no bytes of its own.
bool IsFallbackBuffer(const nlohmann::json& buffer);

/// The content of `view`, count * stride bytes, from the bytes of all buffers. Errors: kInvalidArgument if
/// they are damaged, or too few for what they claim to hold.
absl::StatusOr<std::string> DecodeView(const CompressedView& view,
                                       const std::vector<std::string_view>& buffers);

}  // namespace lumifold::scene
