#include "client/cli/command_help.h"

#include <set>

namespace lumifold::client {

bool OptionHelp::IsFile(const std::string& value_name) {
  static const auto& files = *new std::set<std::string>{"FILE", "DIR", "SCENE", "PICTURE", "REFERENCE"};
  return files.contains(value_name);
}

}  // namespace lumifold::client
