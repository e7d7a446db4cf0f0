#include "proto/rpc/bounded_text.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"

namespace lumifold::rpc {
namespace {

bool IsControl(char c) { return (c >= 0 && c < 0x20) || c == 0x7f; }

/// Whether a byte continues a UTF-8 character.
bool IsContinuation(char c) { return (static_cast<unsigned char>(c) & 0xc0) == 0x80; }

}  // namespace

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
