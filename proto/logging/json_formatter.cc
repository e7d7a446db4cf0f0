#include "proto/logging/json_formatter.h"

#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "proto/logging/fields.h"

namespace lumifold::logging {
namespace {

/// Of a line that is too long: bytes of a value before it is written as JSON, where one may take six.
constexpr size_t kCutValueBytes = 256;
const std::string kCutMember = R"(,"cut":"true")";

std::string JsonText(std::string_view text) {
  return nlohmann::json(std::string(text)).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

/// The members of one object. Names are unique.
class Members {
 public:
  Members(size_t max_bytes, size_t max_value_bytes)
      : max_bytes_(max_bytes), max_value_bytes_(max_value_bytes) {}

  void Add(const std::string& name, std::string_view value) {
    std::string unique = name;
    for (int n = 2; !names_.insert(unique).second; ++n) unique = absl::StrCat(name, "_", n);
    const std::string_view kept = value.substr(0, max_value_bytes_);
    const std::string member = JsonText(unique) + ":" + JsonText(kept);
    const bool fits = text_.size() + member.size() < max_bytes_;
    is_cut_ = is_cut_ || !fits || kept.size() < value.size();
    if (!fits) return;
    if (!text_.empty()) text_ += ',';
    text_ += member;
  }
  bool is_cut() const { return is_cut_; }
  std::string Object() const { return "{" + text_ + (is_cut_ ? kCutMember : "") + "}\n"; }

 private:
  const size_t max_bytes_;
  const size_t max_value_bytes_;
  std::set<std::string> names_;
  std::string text_;
  bool is_cut_ = false;
};

}  // namespace

std::string JsonLine(std::chrono::system_clock::time_point time, std::string_view level,
                     std::string_view line, size_t max_bytes) {
  const Line parsed = ParseLine(line);
  const std::string stamp =
      absl::FormatTime("%Y-%m-%dT%H:%M:%E6SZ", absl::FromChrono(time), absl::UTCTimeZone());
  const auto members = [&](size_t max_value_bytes) {
    Members all(max_bytes - kCutMember.size() - 3, max_value_bytes);
    all.Add("time", stamp);
    all.Add("level", level);
    all.Add("event", parsed.event);
    if (!parsed.text.empty()) all.Add("msg", parsed.text);
    for (const auto& [name, value] : parsed.fields) all.Add(name, value);
    return all;
  };
  const Members whole = members(std::string_view::npos);
  return whole.is_cut() ? members(kCutValueBytes).Object() : whole.Object();
}

std::string_view LevelName(spdlog::level::level_enum level) {
  switch (level) {
    case spdlog::level::trace:
    case spdlog::level::debug:
      return "debug";
    case spdlog::level::info:
      return "info";
    case spdlog::level::warn:
      return "warn";
    default:
      return "error";
  }
}

void JsonFormatter::format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& out) {
  out.append(JsonLine(message.time, LevelName(message.level),
                      {message.payload.data(), message.payload.size()}, max_bytes_));
}

std::unique_ptr<spdlog::formatter> JsonFormatter::clone() const {
  return std::make_unique<JsonFormatter>(max_bytes_);
}

}  // namespace lumifold::logging
