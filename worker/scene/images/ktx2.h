#pragma once

#include <cstdint>
#include <string_view>

#include "absl/status/statusor.h"
#include "worker/scene/scene.h"

namespace lumifold::scene {

/// Whether `bytes` begin as a KTX2 file does.
bool IsKtx2(std::string_view bytes);

/// Decodes the largest level of a 2D picture in one of the two formats that KHR_texture_basisu has, ETC1S
/// with BasisLZ and UASTC with or without Zstandard, as DecodeImage does. A picture of one or two channels
/// (RRR, RRRG) has 0 and opaque in the others; KTXswizzle is applied. One colour of ETC1S takes almost no
/// bytes, so `max_pixels` and 2^20 along a side are the only bounds.
/// Errors: kInvalidArgument if it is damaged or truncated, has another format, or is an array, a cube, 3D, a
/// frame that depends on another one, premultiplied or not stored from the top left; kResourceExhausted over
/// `max_pixels`.
/// Source: the KTX 2.0 specification.
absl::StatusOr<ImageData> DecodeKtx2(std::string_view bytes, int64_t max_pixels);

}  // namespace lumifold::scene
