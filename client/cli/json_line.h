#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace lumifold::client {

/// Version of what `--json` prints: it grows when a field is renamed, removed or changes its meaning, not
/// when one is added. docs/schemas/output.json describes it.
inline constexpr int kJsonSchemaVersion = 1;

/// An object as one line without the newline, with `schema_version` as its first field. Bytes that are not
/// UTF-8 are replaced.
std::string JsonLine(const nlohmann::ordered_json& object);

}  // namespace lumifold::client
