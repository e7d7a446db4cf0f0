#include "proto/logging/fields.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"

namespace lumifold::logging {
namespace {

constexpr std::string_view kEvent = "event";

bool IsOfName(char c) { return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '_'; }

/// Takes the bytes up to the closing quote, and the quote, from a line whose opening quote is taken.
std::string TakeQuoted(std::string_view* line) {
  size_t end = 0;
  while (end < line->size() && (*line)[end] != '"') end += (*line)[end] == '\\' ? 2 : 1;
  end = std::min(end, line->size());
  const std::string_view quoted = line->substr(0, end);
  line->remove_prefix(std::min(end + 1, line->size()));
  std::string value;
  return absl::CUnescape({quoted.data(), quoted.size()}, &value) ? value : std::string(quoted);
}

std::string_view TakeWord(std::string_view* line) {
  const std::string_view word = line->substr(0, line->find(' '));
  line->remove_prefix(word.size());
  return word;
}

}  // namespace

std::string_view Line::Get(std::string_view name) const {
  const auto found =
      std::find_if(fields.begin(), fields.end(), [name](const auto& field) { return field.first == name; });
  return found == fields.end() ? std::string_view() : found->second;
}

Line ParseLine(std::string_view line) {
  Line parsed;
  bool has_event = false;
  while (!line.empty()) {
    if (line.front() == ' ') {
      line.remove_prefix(1);
      continue;
    }
    const size_t name_bytes =
        static_cast<size_t>(std::find_if_not(line.begin(), line.end(), IsOfName) - line.begin());
    if (name_bytes == 0 || name_bytes >= line.size() || line[name_bytes] != '=') {
      absl::StrAppend(&parsed.text, parsed.text.empty() ? "" : " ", std::string(TakeWord(&line)));
      continue;
    }
    std::string name(line.substr(0, name_bytes));
    line.remove_prefix(name_bytes + 1);
    const bool is_quoted = line.starts_with('"');
    if (is_quoted) line.remove_prefix(1);
    std::string value = is_quoted ? TakeQuoted(&line) : std::string(TakeWord(&line));
    if (name == kEvent && !has_event) {
      has_event = true;
      parsed.event = std::move(value);
    } else {
      parsed.fields.emplace_back(std::move(name), std::move(value));
    }
  }
  return parsed;
}

std::string_view EventOf(std::string_view line) {
  if (!line.starts_with("event=")) return "";
  line.remove_prefix(kEvent.size() + 1);
  return TakeWord(&line);
}

std::string Escaped(std::string_view text) {
  return absl::StrCat("\"", absl::Utf8SafeCEscape({text.data(), text.size()}), "\"");
}

std::string Quoted(absl::string_view text) {
  return Escaped(rpc::BoundedLine({text.data(), text.size()}, rpc::kMaxErrorBytes));
}

std::string OneWord(absl::string_view text) {
  return absl::StrReplaceAll(absl::Utf8SafeCEscape(text), {{" ", "\\x20"}});
}

}  // namespace lumifold::logging
