#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "nlohmann/json_fwd.hpp"

/// KHR_animation_pointer: properties of a document by their JSON pointer.
namespace lumifold::scene {

/// What values a property has that is animated by its pointer.
struct PointedProperty {
  int numbers = 1;       // 2 or more: an array
  bool is_flag = false;  // a number that is not 0 is true
};

/// The property of this pointer if the renderer has one: of cameras, lights, materials, and the visibility of
/// nodes.
std::optional<PointedProperty> FindPointer(const std::string& pointer);

/// "/materials/#/alphaCutoff": the pointer without its indices.
std::string PatternOf(const std::string& pointer);

/// Sets a property that FindPointer() knows in the document. Extensions of an object that has none get one.
/// Errors: kInvalidArgument if its object does not exist. Passes on exceptions of the JSON library.
absl::Status SetPointed(const std::string& pointer, std::span<const float> values, nlohmann::json* root);

}  // namespace lumifold::scene
