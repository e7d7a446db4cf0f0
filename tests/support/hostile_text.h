#pragma once

#include <cstdint>
#include <random>
#include <string>
#include <vector>

namespace lumifold {

/// Up to 30 pieces of what breaks parsers of lines: quotes, backslashes, fields, control characters,
/// characters of several bytes, and bytes that are none.
inline std::string HostileText(std::mt19937& random) {
  static const std::vector<std::string> pieces = {
      "\"",       "\\",           "\\\"",         "=",       " ",          "event=",
      " job=j-2", "\" job=\"j-2", "\n",           "\r",      "\t",         std::string(1, '\0'),
      "\x1b[2J",  "\x7f",         "\u00e9",       "\u20ac",  "\U0001f600", "\u2028",
      "\xff",     "\xc3",         "\xed\xa0\x80", "{\"a\":", "a",          "7",
      "\\x4",     "\\0"};
  std::string text;
  for (auto n = random() % 30; n > 0; --n) {
    const size_t piece = random() % (pieces.size() + 1);
    text += piece < pieces.size() ? pieces[piece] : std::string(1, static_cast<char>(random()));
  }
  return text;
}

}  // namespace lumifold
