#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/scene/document.h"
#include "worker/scene/vec.h"

/// Checked reading of accessors: any stride, sparse accessors, normalised integers as glTF 2.0 (3.11) and
/// KHR_mesh_quantization define them. Errors of all functions: kInvalidArgument naming the accessor if it
/// does not exist, has another type, exceeds its buffer view or holds a value that is not finite;
/// kResourceExhausted for a huge count without data.
namespace lumifold::scene {

/// The number of elements.
absl::StatusOr<size_t> ElementCount(const Document& document, int accessor);

absl::StatusOr<std::vector<Vec2>> ReadVec2s(const Document& document, int accessor);
absl::StatusOr<std::vector<Vec3>> ReadVec3s(const Document& document, int accessor);
absl::StatusOr<std::vector<Vec4>> ReadVec4s(const Document& document, int accessor);

/// RGBA; alpha is 1 if the accessor holds RGB.
absl::StatusOr<std::vector<Vec4>> ReadColors(const Document& document, int accessor);

/// `rgb` with alpha 1.
std::vector<Vec4> OpaqueColors(const std::vector<Vec3>& rgb);

/// Elements [first, first + count), concatenated, of an accessor whose elements have `width` components (VEC2
/// to VEC4, or SCALAR). Also an error: the accessor holds fewer elements.
absl::StatusOr<std::vector<float>> ReadFloats(const Document& document, int accessor, int width, size_t first,
                                              size_t count);

/// MAT4; the last row is assumed to be 0 0 0 1.
absl::StatusOr<std::vector<Affine>> ReadMatrices(const Document& document, int accessor);

/// VEC4 of unsigned integers: the joints of a vertex.
absl::StatusOr<std::vector<std::array<uint32_t, 4>>> ReadJoints(const Document& document, int accessor);

/// Unsigned integers of 1, 2 or 4 bytes.
absl::StatusOr<std::vector<uint32_t>> ReadIndices(const Document& document, int accessor);

}  // namespace lumifold::scene
