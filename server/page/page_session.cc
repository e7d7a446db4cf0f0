#include "server/page/page_session.h"

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "server/access/mac.h"

namespace lumifold::page {
namespace {

/// Longer than any session with a credential and a job.
constexpr size_t kMaxTextBytes = 2048;

}  // namespace

// A text is the session in base 64 and the code of that text in hexadecimal, with a dot between them.

std::string SessionSeal::Seal(const v1::PageSession& session) const {
  const std::string text = absl::WebSafeBase64Escape(session.SerializeAsString());
  return absl::StrCat(text, ".", access::MacOf(key_, text));
}

absl::StatusOr<v1::PageSession> SessionSeal::Open(absl::string_view text, absl::Time wall_now) const {
  const size_t point = text.rfind('.');
  std::string bytes;
  v1::PageSession session;
  const bool is_ours = text.size() <= kMaxTextBytes && point != absl::string_view::npos &&
                       access::IsMacOf(text.substr(point + 1), key_, text.substr(0, point)) &&
                       absl::WebSafeBase64Unescape(text.substr(0, point), &bytes) &&
                       session.ParseFromString(bytes);
  if (!is_ours)
    return absl::UnauthenticatedError("the link to this page is not valid; 'lumifold page' makes one");
  if (!IsOpen(session, wall_now))
    return absl::UnauthenticatedError("the link to this page has expired; 'lumifold page' makes a new one");
  return session;
}

}  // namespace lumifold::page
