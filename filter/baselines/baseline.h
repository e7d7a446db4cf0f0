#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"

namespace lumifold::filter {

/// A number that steers a baseline.
struct BaselineParameter {
  std::string name;
  std::string summary;
  float default_value = 0;
  std::vector<float> grid;  // what a search for the best tries
  float least = 0;          // both limits are allowed values
  float most = 0;
};

/// An image-space method that ours is compared with. Its function takes a film with the channels that
/// FilterFilm() asks for and one value for each parameter, in their order and within their limits; it gives
/// R G B of the film's size, finite whatever the film holds, with the same bits for any pool. No baseline
/// antialiases edges or draws its result back to the input: those are no part of what was published.
struct Baseline {
  std::string name;
  std::string summary;  // one line
  std::string source;   // whose method it is
  std::vector<BaselineParameter> parameters;
  std::array<Plane, 3> (*filter)(const LayeredImage& film, absl::Span<const float> values,
                                 TaskPool* pool) = nullptr;
};

/// All of them, in the order tables list them.
const std::vector<Baseline>& Baselines();

/// Null where none has the name.
const Baseline* FindBaseline(std::string_view name);

std::vector<float> DefaultsOf(absl::Span<const BaselineParameter> parameters);
inline std::vector<float> DefaultsOf(const Baseline& baseline) { return DefaultsOf(baseline.parameters); }

/// Every combination of the grids' values, the last parameter changing fastest.
std::vector<std::vector<float>> GridOf(absl::Span<const BaselineParameter> parameters);
inline std::vector<std::vector<float>> GridOf(const Baseline& baseline) {
  return GridOf(baseline.parameters);
}

/// "sigma_s=8,sigma_r=0.1": what is not named keeps its default; "" names none. Errors: kInvalidArgument
/// naming a parameter that is unknown or given twice, or a value that is no number or outside its limits.
absl::StatusOr<std::vector<float>> ParseParameters(const Baseline& baseline, std::string_view text);

/// The text that ParseParameters reads these values from.
std::string FormatParameters(absl::Span<const BaselineParameter> parameters, absl::Span<const float> values);
inline std::string FormatParameters(const Baseline& baseline, absl::Span<const float> values) {
  return FormatParameters(baseline.parameters, values);
}

}  // namespace lumifold::filter
