#pragma once

#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace lumifold::client {

/// Minimum number of insertions, deletions, replacements and swaps of adjacent letters that turn `a` into `b`
/// (optimal string alignment distance).
int EditDistance(absl::string_view a, absl::string_view b);

/// "; did you mean 'X'?" with the word of `words` nearest to `unknown`, the first of equals; empty if no word
/// is near enough.
std::string Suggestion(absl::string_view unknown, const std::vector<std::string>& words);

}  // namespace lumifold::client
