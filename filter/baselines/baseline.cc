#include "filter/baselines/baseline.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "filter/baselines/a_trous.h"
#include "filter/baselines/bilateral.h"
#include "filter/baselines/guided.h"
#include "filter/baselines/manifolds_color.h"
#include "filter/baselines/nfor.h"
#include "filter/baselines/non_local_means.h"

namespace lumifold::filter {
namespace {

absl::Status ReadParameter(const Baseline& baseline, const std::string& key, const std::string& text,
                           std::vector<bool>* given, std::vector<float>* values) {
  for (size_t i = 0; i < baseline.parameters.size(); ++i) {
    const BaselineParameter& parameter = baseline.parameters[i];
    if (parameter.name != key) continue;
    if ((*given)[i])
      return absl::InvalidArgumentError(absl::StrCat(baseline.name, ": ", key, " is given twice"));
    (*given)[i] = true;
    float& value = (*values)[i];
    const bool is_number = absl::SimpleAtof(text, &value);
    if (is_number && value >= parameter.least && value <= parameter.most) return absl::OkStatus();
    return absl::InvalidArgumentError(absl::StrCat(baseline.name, ": ", key, " must be a number from ",
                                                   parameter.least, " to ", parameter.most, ", not '", text,
                                                   "'"));
  }
  std::string names;
  for (const BaselineParameter& p : baseline.parameters)
    absl::StrAppend(&names, names.empty() ? "" : ", ", p.name);
  return absl::InvalidArgumentError(
      absl::StrCat(baseline.name, " has no parameter '", key, "'; it has: ", names));
}

}  // namespace

const std::vector<Baseline>& Baselines() {
  static const std::vector<Baseline> baselines = {
      ManifoldsColorBaseline(), BilateralBaseline(), CrossBilateralBaseline(), ATrousBaseline(),
      ATrousVarianceBaseline(), GuidedBaseline(),    NonLocalMeansBaseline(),  NforBaseline(),
  };
  return baselines;
}

const Baseline* FindBaseline(std::string_view name) {
  const std::vector<Baseline>& all = Baselines();
  const auto found =
      std::find_if(all.begin(), all.end(), [&](const Baseline& baseline) { return baseline.name == name; });
  return found == all.end() ? nullptr : &*found;
}

std::vector<float> DefaultsOf(absl::Span<const BaselineParameter> parameters) {
  std::vector<float> values;
  for (const BaselineParameter& parameter : parameters) values.push_back(parameter.default_value);
  return values;
}

std::vector<std::vector<float>> GridOf(absl::Span<const BaselineParameter> parameters) {
  std::vector<std::vector<float>> points = {{}};
  for (const BaselineParameter& parameter : parameters) {
    std::vector<std::vector<float>> longer;
    for (const std::vector<float>& point : points) {
      for (const float value : parameter.grid) {
        longer.push_back(point);
        longer.back().push_back(value);
      }
    }
    points = std::move(longer);
  }
  return points;
}

absl::StatusOr<std::vector<float>> ParseParameters(const Baseline& baseline, std::string_view text) {
  std::vector<float> values = DefaultsOf(baseline);
  std::vector<bool> given(values.size());
  if (text.empty()) return values;
  const std::vector<std::string> parts = absl::StrSplit(std::string(text), ',');
  for (const std::string& part : parts) {
    const std::pair<std::string, std::string> pair = absl::StrSplit(part, absl::MaxSplits('=', 1));
    const absl::Status status = ReadParameter(baseline, pair.first, pair.second, &given, &values);
    if (!status.ok()) return status;
  }
  return values;
}

std::string FormatParameters(absl::Span<const BaselineParameter> parameters, absl::Span<const float> values) {
  std::string text;
  for (size_t i = 0; i < values.size(); ++i)
    absl::StrAppend(&text, i == 0 ? "" : ",", parameters[i].name, "=", values[i]);
  return text;
}

}  // namespace lumifold::filter
