#pragma once

#include <set>
#include <string>

#include "absl/strings/string_view.h"

namespace lumifold::page {

/// Whether a request was meant for this server. The page of an attacker can give its own name our address,
/// and then read our answers as its own: the name gives it away. Addresses and "localhost" are no names of
/// others. `host`: the header, with or without a port. `names`: further ones that are ours, in lower case.
bool IsOurHost(absl::string_view host, const std::set<std::string>& names);

/// Whether a request comes from a page of this server: `origin` is empty, as where a browser does not send
/// it, or SCHEME://HOST.
bool IsOurOrigin(absl::string_view origin, absl::string_view scheme, absl::string_view host);

}  // namespace lumifold::page
