#include "proto/rpc/endpoints.h"

#include <algorithm>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "proto/rpc/credentials.h"

namespace lumifold::rpc {
namespace {

absl::Status CheckEndpoint(const std::string& endpoint) {
  absl::string_view path = endpoint;
  if (absl::ConsumePrefix(&path, "unix:")) {
    return path.empty() ? absl::InvalidArgumentError("'unix:' without a path") : absl::OkStatus();
  }
  HostAndPort parsed;
  if (absl::Status status = ParseHostAndPort(endpoint, &parsed); !status.ok()) return status;
  if (parsed.port == 0)
    return absl::InvalidArgumentError(absl::StrCat("'", endpoint, "': no one listens on port 0"));
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::vector<std::string>> ParseEndpoints(const std::string& list) {
  std::vector<std::string> endpoints;
  for (const absl::string_view part : absl::StrSplit(list, ',')) {
    std::string endpoint(absl::StripAsciiWhitespace(part));
    if (absl::Status status = CheckEndpoint(endpoint); !status.ok()) return status;
    if (std::find(endpoints.begin(), endpoints.end(), endpoint) != endpoints.end())
      return absl::InvalidArgumentError(
          absl::StrCat("'", endpoint, "' is twice in the list of coordinators"));
    if (endpoints.size() == kMaxEndpoints)
      return absl::InvalidArgumentError(
          absl::StrCat("more than ", kMaxEndpoints, " coordinators in the list"));
    endpoints.push_back(std::move(endpoint));
  }
  return endpoints;
}

}  // namespace lumifold::rpc
