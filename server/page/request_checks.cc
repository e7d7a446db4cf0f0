#include "server/page/request_checks.h"

#include <arpa/inet.h>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"

namespace lumifold::page {
namespace {

bool IsAddress(int family, const std::string& text) {
  in6_addr address = {};
  return inet_pton(family, text.c_str(), &address) == 1;
}

}  // namespace

bool IsOurHost(absl::string_view host, const std::set<std::string>& names) {
  if (!host.empty() && host.front() == '[') {
    const size_t end = host.find(']');
    const bool ends = end != absl::string_view::npos && (end + 1 == host.size() || host[end + 1] == ':');
    return ends && IsAddress(AF_INET6, std::string(host.substr(1, end - 1)));
  }
  const std::string name = absl::AsciiStrToLower(host.substr(0, host.find(':')));
  return name == "localhost" || (!name.empty() && names.contains(name)) || IsAddress(AF_INET, name);
}

bool IsOurOrigin(absl::string_view origin, absl::string_view scheme, absl::string_view host) {
  return origin.empty() || origin == absl::StrCat(scheme, "://", host);
}

}  // namespace lumifold::page
