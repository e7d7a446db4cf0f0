#include "proto/rpc/bounded_text.h"

#include <algorithm>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"

namespace lumifold::rpc {
namespace {

bool IsControl(char c) { return (c >= 0 && c < 0x20) || c == 0x7f; }

/// Whether a byte continues a UTF-8 character.
bool IsContinuation(char c) { return (static_cast<unsigned char>(c) & 0xc0) == 0x80; }

/// The length of the UTF-8 character at the front of `text`; 0 if there is none, as RFC 3629 has it.
size_t CharacterLength(std::string_view text) {
  const auto byte = [&](size_t i) { return static_cast<unsigned char>(text[i]); };
  if (byte(0) < 0x80) return 1;
  const size_t length = byte(0) >= 0xf0 ? 4 : byte(0) >= 0xe0 ? 3 : 2;
  if (byte(0) < 0xc2 || byte(0) > 0xf4 || text.size() < length) return 0;
  for (size_t i = 1; i < length; ++i) {
    if (!IsContinuation(text[i])) return 0;
  }
  const bool is_overlong = (byte(0) == 0xe0 && byte(1) < 0xa0) || (byte(0) == 0xf0 && byte(1) < 0x90);
  const bool is_outside = (byte(0) == 0xed && byte(1) >= 0xa0) || (byte(0) == 0xf4 && byte(1) >= 0x90);
  return is_overlong || is_outside ? 0 : length;
}

/// Whether a character controls a terminal: those of ASCII, and U+0080 to U+009F.
bool IsControlCharacter(std::string_view character) {
  if (character.size() == 1) return IsControl(character[0]);
  return character.size() == 2 && character[0] == '\xc2' && static_cast<unsigned char>(character[1]) < 0xa0;
}

}  // namespace

std::string Printable(std::string_view text) {
  std::string line;
  while (!text.empty()) {
    const size_t length = CharacterLength(text);
    const std::string_view character = text.substr(0, std::max<size_t>(length, 1));
    if (length > 0 && !IsControlCharacter(character))
      line.append(character);
    else
      line.append(absl::CHexEscape({character.data(), character.size()}));
    text.remove_prefix(character.size());
  }
  return line;
}

std::string AsUtf8(std::string_view text) {
  std::string valid;
  while (!text.empty()) {
    const size_t length = CharacterLength(text);
    valid.append(length > 0 ? text.substr(0, length) : "\xef\xbf\xbd");
    text.remove_prefix(std::max<size_t>(length, 1));
  }
  return valid;
}

std::string BoundedLine(std::string_view text, size_t max_bytes) {
  std::string line(text.substr(0, max_bytes));
  if (text.size() > max_bytes) {
    constexpr size_t kNoteBytes = 48;  // "... (18446744073709551615 bytes left out)"
    size_t kept = max_bytes - kNoteBytes;
    while (kept > 0 && IsContinuation(text[kept])) --kept;
    line.resize(kept);
    absl::StrAppend(&line, "... (", text.size() - kept, " bytes left out)");
  }
  std::replace_if(line.begin(), line.end(), IsControl, ' ');
  return line;
}

void LineCollector::Add(std::string_view text) {
  std::string line = BoundedLine(text, max_bytes_);
  if (std::find(lines_.begin(), lines_.end(), line) != lines_.end()) return;
  if (lines_.size() < max_lines_) {
    lines_.push_back(std::move(line));
  } else {
    ++left_out_;
  }
}

std::vector<std::string> LineCollector::Take() {
  if (left_out_ > 0) lines_.back() = absl::StrCat(left_out_ + 1, " further warnings are left out");
  return std::move(lines_);
}

}  // namespace lumifold::rpc
