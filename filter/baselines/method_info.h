#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"

namespace lumifold::filter {

/// A number that controls a method.
struct MethodParameter {
  std::string name;
  std::string summary;
  float default_value = 0;
  /// The values that a search for the best setting tries, the most promising first.
  std::vector<float> grid;
  float least = 0;  // the range of allowed values, both ends included
  float most = 0;
};

/// The one record of a method that makes a picture. The command line, the charts and the stability table list
/// methods from it.
///
/// Where a method that ours is compared with lives: a filter of a finished film ships with the program as
/// `lumifold filter --method NAME` and lives in filter/baselines. A method that needs single samples or rays
/// of its own exists for the charts only: it lives in tests/charts/methods/samples if it reads the samples of
/// a film, and in tests/charts/methods/rendering if it renders the scene itself.
struct MethodInfo {
  std::string name;
  std::string summary;  // one line
  std::string source;   // the publication and, where this is not what was published, the difference
  std::vector<MethodParameter> parameters;
  /// Whether the method reads auxiliary data of a film: layers, halves or features, which cost time to
  /// render. If not, it reads the plain picture C alone, and the charts charge it for nothing else.
  bool uses_auxiliary = true;
};

/// The default value of each parameter, in their order.
std::vector<float> DefaultsOf(const MethodInfo& method);

/// Every combination of the grids' values, the last parameter changing fastest.
std::vector<std::vector<float>> GridOf(const MethodInfo& method);

/// Reads "sigma_s=8,sigma_r=0.1". A parameter that is not named keeps its default; "" names none.
/// Errors: kInvalidArgument naming a parameter that is unknown or given twice, or a value that is not a
///         number or outside its range.
absl::StatusOr<std::vector<float>> ParseParameters(const MethodInfo& method, std::string_view text);

/// The text that ParseParameters reads these values from.
std::string FormatParameters(const MethodInfo& method, absl::Span<const float> values);

/// A table for people: name and summary of each method, its source, whether the plain picture is enough for
/// it, and a line for each parameter with its default and range.
std::string MethodTable(absl::Span<const MethodInfo> methods);

/// The same for programs, one JSON object a line: {"name": ..., "summary": ..., "source": ..., "auxiliary":
/// true, "parameters": [{"name": ..., "summary": ..., "default": 8, "least": 0.5, "most": 32}]}.
std::string MethodsAsJson(absl::Span<const MethodInfo> methods);

/// "a, b and c".
std::string MethodNames(absl::Span<const MethodInfo> methods);

}  // namespace lumifold::filter
