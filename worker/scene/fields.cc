#include "worker/scene/fields.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/str_cat.h"

namespace lumifold::scene {

void FieldReader::Fail(const std::string& message) {
  if (status_.ok()) status_ = absl::InvalidArgumentError(absl::StrCat(place_, ": ", message));
}

float FieldReader::Finite(double value, const char* field) {
  // Compared in double, because converting a double outside float's range is undefined.
  if (std::isfinite(value) && std::fabs(value) <= double{std::numeric_limits<float>::max()}) {
    return static_cast<float>(value);
  }
  Fail(absl::StrCat(field, " is not finite as a 32-bit number"));
  return 0;
}

float FieldReader::Clamped(double value, double low, double high, const char* field) {
  const float inside = Finite(std::clamp(value, low, high), field);
  if (value < low || value > high) {
    diagnostics_->Count(absl::StrCat("values of ", field, " outside ", low, " to ", high, " clamped"),
                        place_);
  }
  return inside;
}

double FieldReader::Number(const tinygltf::Value& object, const char* field, double otherwise) {
  if (!object.Has(field)) return otherwise;
  const tinygltf::Value& value = object.Get(field);
  if (value.IsNumber()) return value.GetNumberAsDouble();
  Fail(absl::StrCat(field, " is not a number"));
  return otherwise;
}

void FieldReader::ReadNumbers(const tinygltf::Value& object, const char* field, double* out, size_t count) {
  if (!object.Has(field)) return;
  const tinygltf::Value& value = object.Get(field);
  if (!value.IsArray() || value.ArrayLen() != count) {
    Fail(absl::StrCat(field, " is not an array of ", count, " numbers"));
    return;
  }
  for (size_t i = 0; i < count; ++i) {
    const tinygltf::Value& element = value.Get(static_cast<int>(i));
    if (!element.IsNumber()) return Fail(absl::StrCat(field, "[", i, "] is not a number"));
    out[i] = element.GetNumberAsDouble();
  }
}

const tinygltf::Value* FindExtension(const tinygltf::ExtensionMap& extensions, const char* name) {
  const auto found = extensions.find(name);
  return found != extensions.end() && found->second.IsObject() ? &found->second : nullptr;
}

}  // namespace lumifold::scene
