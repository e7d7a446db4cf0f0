#include "client/options/job_schema.h"

#include <nlohmann/json.hpp>

#include "absl/strings/ascii.h"

namespace lumifold::client {
namespace {

using Json = nlohmann::ordered_json;

/// Of the value of an option, by the name that its help has for it.
Json ValueSchema(const OptionHelp& option) {
  if (option.is_flag()) return {{"type", "boolean"}};
  if (option.value_name == "N") return {{"type", "integer"}};
  if (option.value_name == "X" || option.value_name == "DEGREES" || option.value_name == "METRES")
    return {{"type", "number"}};
  // "7" is written as a number as well.
  Json text = {{"type", Json::array({"string", "number"})}};
  if (!option.is_repeatable) return text;
  return {{"anyOf", Json::array({text, {{"type", "array"}, {"items", text}}})}};
}

void AddOption(const OptionHelp& option, Json* properties) {
  const auto add = [&](const std::string& name) {
    Json schema = ValueSchema(option);
    schema["description"] = option.help;
    (*properties)[name] = std::move(schema);
  };
  if (option.is_argument()) add(absl::AsciiStrToLower(option.value_name));
  for (const std::string& name : option.names) {
    const bool belongs = name.starts_with("--") && name != "--help" && name != "--job";
    if (belongs) add(name.substr(2));
  }
}

}  // namespace

std::string JobSchema(const std::vector<CommandHelp>& commands) {
  Json properties = Json::object();
  for (const CommandHelp& command : commands) {
    for (const OptionHelp& option : command.options) AddOption(option, &properties);
  }
  const Json schema = {{"$schema", "https://json-schema.org/draft/2020-12/schema"},
                       {"title", "Job file of lumifold"},
                       {"description", "Options of 'lumifold submit', 'render' and 'plan', for --job"},
                       {"type", "object"},
                       {"properties", properties},
                       {"additionalProperties", false}};
  return schema.dump(2) + "\n";
}

}  // namespace lumifold::client
