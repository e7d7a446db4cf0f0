#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

namespace lumifold::autoscale {

struct HttpRequest {
  std::string method = "GET";
  std::string url = {};
  std::vector<std::string> headers = {};  // "Name: value"
  std::string body = {};
  /// Certificates of the authorities that may vouch for the server; empty: those of this machine.
  std::string ca_file = {};
  absl::Duration timeout = absl::Seconds(10);
};

struct HttpAnswer {
  int code = 0;
  std::string body = {};
};

/// One call over HTTP or HTTPS, without redirects and proxies.
/// Errors: kUnavailable, with the URL, when no whole answer came within `timeout`, or one of more than 64
/// MiB. An answer of any code is no error.
absl::StatusOr<HttpAnswer> CallHttp(const HttpRequest& request);

/// The text as part of a query.
std::string UrlEscape(const std::string& text);

}  // namespace lumifold::autoscale
