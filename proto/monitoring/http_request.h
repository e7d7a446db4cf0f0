#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>

#include "absl/strings/string_view.h"

namespace lumifold::monitoring {

/// Bytes of a request up to the empty line after its headers; a longer one is refused.
inline constexpr size_t kMaxRequestBytes = 8192;

/// Answers the first bytes of a connection as HTTP/1.1 does for one resource, `path`, and closes the connection.
/// GET and HEAD of it get `text()`, which is called for them only; other paths 404, other methods 405, what is not HTTP
/// 400, too many bytes 431. Headers and bodies of requests are not looked at. nullopt: the request is not complete.
std::optional<std::string> Answer(absl::string_view request, absl::string_view path,
                                  const std::function<std::string()>& text);

}  // namespace lumifold::monitoring
