#pragma once

#include <cstdint>
#include <string_view>

#include "absl/status/status.h"
#include "worker/scene/scene.h"

namespace lumifold::scene {

/// The parts of a BasisLZ picture of ETC1S blocks, as a KTX2 file stores them.
struct Etc1sPicture {
  int endpoint_count = 0;
  int selector_count = 0;
  std::string_view endpoints;  // the codebook of colours
  std::string_view selectors;  // the codebook of which of its block's four colours a pixel has
  std::string_view tables;     // the Huffman codes of the slices
  std::string_view color_slice;
  std::string_view alpha_slice;  // empty: opaque
};

/// Decodes into the whole of `image`. Alpha is the green of the alpha slice.
/// Errors: kInvalidArgument if a part is damaged or truncated.
/// Source: the KTX 2.0 specification, "BasisLZ/ETC1S Bitstream", and the Khronos Data Format Specification,
/// "ETC1 Compressed Texture Image Formats".
absl::Status DecodeEtc1s(const Etc1sPicture& picture, ImageData* image);

}  // namespace lumifold::scene
