#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace lumifold::http {

/// Names and values, in their order.
using Headers = std::vector<std::pair<std::string, std::string>>;

/// A request, received in full.
struct Request {
  std::string method = {};  // in capitals
  std::string path = {};    // as it was sent, without the query; begins with "/"
  std::string query = {};   // as it was sent, without "?"
  Headers headers = {};
  std::string body = {};

  /// The first header of this name, in upper or lower case; empty without one.
  absl::string_view Header(absl::string_view name) const;
  /// The first parameter of the query with this name, decoded; nullopt without one.
  std::optional<std::string> Parameter(absl::string_view name) const;
};

/// What a handler answers. The server adds the length and what is about the connection, and leaves the body
/// out for HEAD.
struct Response {
  int status = 200;
  std::string content_type = {};  // empty: no such header
  std::string body = {};
  Headers headers = {};
  /// If set, produces the body in place of `body`: pieces until nullopt, the end; an empty piece sends
  /// nothing. An error closes the connection, so that the caller sees that its answer is not complete.
  /// Called by a thread of the handlers, `pause` after the piece before was sent. It is destroyed when the
  /// connection ends.
  std::function<absl::StatusOr<std::optional<std::string>>()> stream = nullptr;
  /// Bytes of all pieces, where that is known; the answer then states its length. With fewer or more the
  /// connection is closed.
  std::optional<uint64_t> stream_bytes = std::nullopt;
  absl::Duration pause = absl::ZeroDuration();
};

}  // namespace lumifold::http
