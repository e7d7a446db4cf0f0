#pragma once

#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace lumifold::client {

/// Colours of terminals, as the numbers of their escape sequences.
enum class Colour { kRed = 31, kGreen = 32, kYellow = 33 };

/// The text in a colour, if `is_wanted`: only terminals show it.
inline std::string Coloured(bool is_wanted, Colour colour, absl::string_view text) {
  return is_wanted ? absl::StrCat("\x1b[", static_cast<int>(colour), "m", text, "\x1b[0m")
                   : std::string(text);
}

/// Whether a terminal may be given colours, by the variables NO_COLOR (set and not empty: no) and TERM
/// ("dumb": no). Null: a variable that is not set.
inline bool WantsColour(bool is_terminal, const char* no_color, const char* term) {
  return is_terminal && (no_color == nullptr || *no_color == '\0') &&
         absl::string_view(term == nullptr ? "" : term) != "dumb";
}

}  // namespace lumifold::client
