#pragma once

#include <vector>

#include "absl/strings/string_view.h"

namespace lumifold::page {

/// A file of the page that is part of the program.
struct WebFile {
  absl::string_view name;  // "app.js"
  absl::string_view content;
};

/// Those of WEB_FILES in CMakeLists.txt.
const std::vector<WebFile>& WebFiles();

}  // namespace lumifold::page
