#include "client/cli/json_line.h"

#include <nlohmann/json.hpp>

namespace lumifold::client {

std::string JsonLine(const nlohmann::ordered_json& object) {
  nlohmann::ordered_json line{{"schema_version", kJsonSchemaVersion}};
  for (const auto& [name, value] : object.items()) line[name] = value;
  return line.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace lumifold::client
