#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/strings/string_view.h"

/// The form of a line of the log: "event=unit_failed unit="j-1 frame 0" worker=w-7/node error="..."". A value
/// without quotes ends at the next space; a quoted one has the escapes of C. What is not name=value is free
/// text.
namespace lumifold::logging {

/// A line, taken apart.
struct Line {
  /// The value of `event`; empty where the line has none.
  std::string event;
  /// All others in their order, with their values as they were before they were quoted. Names may repeat.
  std::vector<std::pair<std::string, std::string>> fields;
  /// The words of the free text.
  std::string text;

  /// The first value of this name; empty if there is none.
  std::string_view Get(std::string_view name) const;
};

/// Takes any bytes apart: a quote that is missing ends with the line, and escapes that are none stay as they
/// are.
Line ParseLine(std::string_view line);

/// The value of `event`, as in ParseLine, of a line that begins with it; otherwise empty.
std::string_view EventOf(std::string_view line);

/// Any bytes as a quoted value: ParseLine gives them back.
std::string Escaped(std::string_view text);

/// Text of others as a quoted value of bounded length, where control characters are spaces
/// (rpc::BoundedLine). What a line says of names, errors and paths must be Quoted, or it could add fields and
/// lines.
std::string Quoted(absl::string_view text);

/// Text of others as a value without quotes: escaped, and one word.
std::string OneWord(absl::string_view text);

}  // namespace lumifold::logging
