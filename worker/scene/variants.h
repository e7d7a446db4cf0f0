#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/scene/tinygltf.h"

namespace lumifold::scene {

/// Names of the variants of KHR_materials_variants, by number.
std::vector<std::string> VariantNames(const tinygltf::Model& model);

/// The number of the variant that a user asks for by name or number; kNone for "".
/// Error: kNotFound, naming those that exist.
absl::StatusOr<int> FindVariant(const std::vector<std::string>& names, const std::string& wanted);

/// The material of a primitive in that variant.
int MaterialOf(const tinygltf::Primitive& primitive, int variant);

/// Whether each material of the document may be seen in that variant: those of primitives, or all of a
/// document without variants.
std::vector<bool> MaterialsInUse(const tinygltf::Model& model, int variant);

}  // namespace lumifold::scene
