#include "server/webhooks/targets.h"

#include <curl/curl.h>

#include <algorithm>
#include <memory>
#include <optional>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace lumifold::webhooks {
namespace {

/// A URL as libcurl reads it.
class ParsedUrl {
 public:
  explicit ParsedUrl(const std::string& url)
      : parsed_(curl_url()),
        result_(curl_url_set(parsed_.get(), CURLUPART_URL, url.c_str(), CURLU_DISALLOW_USER)) {}

  bool ok() const { return result_ == CURLUE_OK; }
  bool has_user() const { return result_ == CURLUE_USER_NOT_ALLOWED; }
  std::optional<std::string> Get(CURLUPart part, unsigned flags = 0) const {
    char* text = nullptr;
    if (curl_url_get(parsed_.get(), part, &text, flags) != CURLUE_OK) return std::nullopt;
    std::string copy = text;
    curl_free(text);
    return copy;
  }

 private:
  struct Free {
    void operator()(CURLU* parsed) const { curl_url_cleanup(parsed); }
  };

  const std::unique_ptr<CURLU, Free> parsed_;
  const CURLUcode result_;
};

bool IsHostCharacter(char c) {
  return absl::ascii_isalnum(c) || absl::StrContains(".-:[]", absl::string_view(&c, 1));
}

std::string HostOf(const ParsedUrl& url) {
  return absl::AsciiStrToLower(url.Get(CURLUPART_HOST).value_or(""));
}

std::string OriginOf(absl::string_view scheme, absl::string_view host, absl::string_view port) {
  return absl::StrCat(scheme, "://", host, ":", port);
}

absl::Status NotAllowed(const std::string& origin) {
  return absl::PermissionDeniedError(
      absl::StrCat("webhook: the operator does not allow ", origin, " (lumifold-server --webhook-hosts)"));
}

}  // namespace

absl::StatusOr<Target> ParseTarget(const std::string& url) {
  if (url.size() > kMaxUrlBytes)
    return absl::InvalidArgumentError(
        absl::StrCat("webhook has ", url.size(), " bytes, allowed are ", kMaxUrlBytes));
  // Other readers of URLs take a backslash for a slash.
  const bool is_plain = std::all_of(url.begin(), url.end(),
                                    [](char c) { return absl::ascii_isgraph(c) && c != '\\' && c != '#'; });
  const ParsedUrl parsed(url);
  if (parsed.has_user()) return absl::InvalidArgumentError("webhook: a URL with a user is not allowed");
  const std::string scheme = parsed.Get(CURLUPART_SCHEME).value_or("");
  if (!is_plain || !parsed.ok() || (scheme != "https" && scheme != "http"))
    return absl::InvalidArgumentError(
        "webhook is no URL such as https://HOST/PATH, of printable ASCII characters and without a fragment");
  const std::string host = HostOf(parsed);
  const bool has_zone = parsed.Get(CURLUPART_ZONEID).has_value();
  if (host.empty() || has_zone || !std::all_of(host.begin(), host.end(), IsHostCharacter))
    return absl::InvalidArgumentError(
        "webhook: its host is neither a name of letters, digits, '-' and '.', nor an address");
  return Target{
      .url = parsed.Get(CURLUPART_URL).value_or(""),
      .origin = OriginOf(scheme, host, parsed.Get(CURLUPART_PORT, CURLU_DEFAULT_PORT).value_or(""))};
}

absl::StatusOr<AllowedHosts> AllowedHosts::Parse(absl::string_view list) {
  AllowedHosts allowed;
  if (list.empty()) return allowed;
  for (const absl::string_view entry : absl::StrSplit(list, ',')) {
    const std::string text(absl::StripAsciiWhitespace(entry));
    const absl::StatusOr<Target> target = ParseTarget(absl::StrCat("https://", text, "/"));
    const ParsedUrl parsed(absl::StrCat("https://", text, "/"));
    if (!target.ok() || parsed.Get(CURLUPART_PATH) != "/" || parsed.Get(CURLUPART_QUERY).has_value())
      return absl::InvalidArgumentError(
          absl::StrCat("--webhook-hosts: '", text, "' is neither HOST nor HOST:PORT"));
    const std::optional<std::string> port = parsed.Get(CURLUPART_PORT);
    allowed.origins_.push_back(OriginOf("https", HostOf(parsed), port.value_or("443")));
    allowed.origins_.push_back(OriginOf("http", HostOf(parsed), port.value_or("80")));
  }
  return allowed;
}

absl::StatusOr<Target> AllowedHosts::Check(const std::string& url) const {
  if (origins_.empty())
    return absl::FailedPreconditionError(
        "webhook: this farm calls none; its operator allows hosts with lumifold-server --webhook-hosts");
  absl::StatusOr<Target> target = ParseTarget(url);
  if (!target.ok()) return target;
  const bool is_allowed = std::find(origins_.begin(), origins_.end(), target->origin) != origins_.end();
  return is_allowed ? target : NotAllowed(target->origin);
}

}  // namespace lumifold::webhooks
