#include "filter/baselines/method_info.h"

#include <cstddef>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

namespace lumifold::filter {
namespace {

absl::Status ReadParameter(const MethodInfo& method, const std::string& key, const std::string& text,
                           std::vector<bool>* given, std::vector<float>* values) {
  for (size_t i = 0; i < method.parameters.size(); ++i) {
    const MethodParameter& parameter = method.parameters[i];
    if (parameter.name != key) continue;
    if ((*given)[i])
      return absl::InvalidArgumentError(absl::StrCat(method.name, ": ", key, " is given twice"));
    (*given)[i] = true;
    float& value = (*values)[i];
    const bool is_number = absl::SimpleAtof(text, &value);
    if (is_number && value >= parameter.least && value <= parameter.most) return absl::OkStatus();
    return absl::InvalidArgumentError(absl::StrCat(method.name, ": ", key, " must be a number from ",
                                                   parameter.least, " to ", parameter.most, ", not '", text,
                                                   "'"));
  }
  if (method.parameters.empty())
    return absl::InvalidArgumentError(absl::StrCat(method.name, " takes no parameters"));
  const std::string names = absl::StrJoin(
      method.parameters, ", ", [](std::string* out, const MethodParameter& p) { out->append(p.name); });
  return absl::InvalidArgumentError(
      absl::StrCat(method.name, " has no parameter '", key, "'; it has: ", names));
}

std::string JsonString(const std::string& text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') quoted += '\\';
    quoted += c;
  }
  return quoted + "\"";
}

std::string ParameterJson(const MethodParameter& parameter) {
  return absl::StrCat("{\"name\": ", JsonString(parameter.name),
                      ", \"summary\": ", JsonString(parameter.summary),
                      ", \"default\": ", parameter.default_value, ", \"least\": ", parameter.least,
                      ", \"most\": ", parameter.most, "}");
}

}  // namespace

std::vector<float> DefaultsOf(const MethodInfo& method) {
  std::vector<float> values;
  for (const MethodParameter& parameter : method.parameters) values.push_back(parameter.default_value);
  return values;
}

std::vector<std::vector<float>> GridOf(const MethodInfo& method) {
  std::vector<std::vector<float>> points = {{}};
  for (const MethodParameter& parameter : method.parameters) {
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

absl::StatusOr<std::vector<float>> ParseParameters(const MethodInfo& method, std::string_view text) {
  std::vector<float> values = DefaultsOf(method);
  std::vector<bool> given(values.size());
  if (text.empty()) return values;
  const std::vector<std::string> parts = absl::StrSplit(std::string(text), ',');
  for (const std::string& part : parts) {
    const std::pair<std::string, std::string> pair = absl::StrSplit(part, absl::MaxSplits('=', 1));
    const absl::Status status = ReadParameter(method, pair.first, pair.second, &given, &values);
    if (!status.ok()) return status;
  }
  return values;
}

std::string FormatParameters(const MethodInfo& method, absl::Span<const float> values) {
  std::string text;
  for (size_t i = 0; i < values.size(); ++i)
    absl::StrAppend(&text, i == 0 ? "" : ",", method.parameters[i].name, "=", values[i]);
  return text;
}

std::string MethodTable(absl::Span<const MethodInfo> methods) {
  std::string text;
  for (const MethodInfo& method : methods) {
    absl::StrAppendFormat(&text, "%-18s%s\n%18s%s\n", method.name, method.summary, "", method.source);
    if (!method.uses_auxiliary) absl::StrAppendFormat(&text, "%18sneeds the plain picture alone\n", "");
    for (const MethodParameter& p : method.parameters) {
      absl::StrAppendFormat(&text, "  %16s%s=%g (%g to %g): %s\n", "", p.name, p.default_value, p.least,
                            p.most, p.summary);
    }
  }
  return text;
}

std::string MethodsAsJson(absl::Span<const MethodInfo> methods) {
  std::string text;
  for (const MethodInfo& method : methods) {
    const std::string parameters = absl::StrJoin(
        method.parameters, ", ",
        [](std::string* out, const MethodParameter& parameter) { out->append(ParameterJson(parameter)); });
    absl::StrAppend(&text, "{\"name\": ", JsonString(method.name),
                    ", \"summary\": ", JsonString(method.summary),
                    ", \"source\": ", JsonString(method.source),
                    ", \"auxiliary\": ", method.uses_auxiliary ? "true" : "false", ", \"parameters\": [",
                    parameters, "]}\n");
  }
  return text;
}

std::string MethodNames(absl::Span<const MethodInfo> methods) {
  std::string names;
  for (size_t i = 0; i < methods.size(); ++i) {
    const bool is_last = i + 1 == methods.size();
    absl::StrAppend(&names, i == 0 ? "" : is_last ? " and " : ", ", methods[i].name);
  }
  return names;
}

}  // namespace lumifold::filter
