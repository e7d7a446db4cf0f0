#pragma once

#include <array>
#include <map>
#include <string>

#include "absl/status/status.h"
#include "worker/scene/diagnostics.h"
#include "worker/scene/tinygltf.h"
#include "worker/scene/vec.h"

namespace lumifold::scene {

/// Reads numbers of one object of the document, for example a material, and stores the first error, so that
/// callers check once at the end. After an error every read returns its default.
class FieldReader {
 public:
  /// `place` is the prefix of every error; both arguments must outlive the reader.
  FieldReader(const std::string& place, Diagnostics* diagnostics)
      : place_(place), diagnostics_(diagnostics) {}

  const std::string& place() const { return place_; }
  const absl::Status& status() const { return status_; }
  void Fail(const std::string& message);

  /// `value` as float. Error: not finite as float.
  float Finite(double value, const char* field);

  /// As Finite, clamped to [low, high]; clamping is counted in the diagnostics.
  float Clamped(double value, double low, double high, const char* field);

  /// Member `field` of an extension's object, or the default if it is missing. Error: another type.
  double Number(const tinygltf::Value& object, const char* field, double otherwise);

  /// The same for an array of N numbers.
  template <size_t N>
  std::array<double, N> Numbers(const tinygltf::Value& object, const char* field,
                                std::array<double, N> otherwise) {
    ReadNumbers(object, field, otherwise.data(), N);
    return otherwise;
  }

 private:
  void ReadNumbers(const tinygltf::Value& object, const char* field, double* out, size_t count);

  const std::string& place_;
  Diagnostics* diagnostics_;
  absl::Status status_;
};

/// The object of extension `name`, or null.
const tinygltf::Value* FindExtension(const tinygltf::ExtensionMap& extensions, const char* name);

}  // namespace lumifold::scene
