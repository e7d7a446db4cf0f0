#pragma once

#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace lumifold::client {

/// Insertions, deletions, replacements and swaps of neighbours that turn `a` into `b`, at least (optimal
/// string alignment).
int EditDistance(absl::string_view a, absl::string_view b);

/// "; did you mean 'X'?" with the word nearest to `unknown`, the first of equals; empty where none is near
/// enough to be a slip.
std::string Suggestion(absl::string_view unknown, const std::vector<std::string>& words);

}  // namespace lumifold::client
