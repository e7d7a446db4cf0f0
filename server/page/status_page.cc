#include "server/page/status_page.h"

#include <algorithm>
#include <atomic>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "proto/http/server.h"
#include "proto/retry/storage_away.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/rect_codec.h"
#include "proto/rpc/version.h"
#include "proto/sockets/listening_sockets.h"
#include "server/page/downloads.h"
#include "server/page/farm_calls.h"
#include "server/page/farm_view.h"
#include "server/page/page_session.h"
#include "server/page/request_checks.h"
#include "server/page/shared_previews.h"
#include "server/page/uploads.h"
#include "server/page/web_files.h"

namespace lumifold::page {
namespace {

using http::Request;
using http::Response;

constexpr absl::string_view kCallPath = "/api/call/";
/// How long a ticket is valid: a download begins at once.
constexpr absl::Duration kTicketTime = absl::Minutes(1);
/// Of an asset; that of the protocol.
constexpr size_t kMaxPartBytes = size_t{1} << 20;
constexpr int kDefaultHours = 12;
constexpr int kMostHours = 720;
/// Between two looks of a viewer at what has changed.
constexpr absl::Duration kRound = absl::Milliseconds(500);
/// A viewer that hears nothing for this long knows that the connection is lost; a write finds it too.
constexpr absl::Duration kPing = absl::Seconds(5);

/// Scripts and styles are files of ours; nothing else is loaded, and no other page shows this one.
constexpr char kContentSecurityPolicy[] =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src "
    "'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

int HttpCodeOf(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kOutOfRange:
      return 400;
    case absl::StatusCode::kUnauthenticated:
      return 401;
    case absl::StatusCode::kPermissionDenied:
      return 403;
    case absl::StatusCode::kNotFound:
      return 404;
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kAlreadyExists:
    case absl::StatusCode::kAborted:
      return 409;
    case absl::StatusCode::kResourceExhausted:
      return 429;
    case absl::StatusCode::kUnavailable:
    case absl::StatusCode::kDeadlineExceeded:
    case absl::StatusCode::kCancelled:
      return 503;
    default:
      return 500;
  }
}

Response JsonResponse(const nlohmann::ordered_json& json, int status = 200) {
  // Texts of others may be no UTF-8.
  return {.status = status,
          .content_type = "application/json",
          .body = json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace)};
}

Response ErrorResponse(const absl::Status& status) {
  return JsonResponse({{"error",
                        {{"code", absl::StatusCodeToString(status.code())},
                         {"message", std::string(retry::ForCaller(status).message())}}}},
                      HttpCodeOf(status));
}

absl::string_view TypeOf(absl::string_view name) {
  static const auto& types =
      *new std::map<absl::string_view, absl::string_view>{{"html", "text/html; charset=utf-8"},
                                                          {"js", "text/javascript; charset=utf-8"},
                                                          {"css", "text/css; charset=utf-8"},
                                                          {"svg", "image/svg+xml"}};
  return types.at(name.substr(name.rfind('.') + 1));
}

/// The file of the page at a path; nullptr: there is none.
const WebFile* FileAt(absl::string_view path) {
  const absl::string_view name = path == "/" ? "index.html" : absl::StripPrefix(path, "/");
  for (const WebFile& file : WebFiles()) {
    if (file.name == name) return &file;
  }
  return nullptr;
}

/// A browser that watches events.
struct Viewer {
  /// Counted in `viewers` while it exists.
  explicit Viewer(std::atomic<int>* viewers) : count(*viewers) { ++count; }
  Viewer(const Viewer&) = delete;
  Viewer& operator=(const Viewer&) = delete;
  ~Viewer() { --count; }

  std::atomic<int>& count;
  uint64_t has = 0;  // number of the look
  absl::Time last = absl::InfinitePast();
};

class StatusPageImpl final : public StatusPage {
 public:
  explicit StatusPageImpl(StatusPageOptions options)
      : options_(std::move(options)),
        seal_(options_.session_key),
        calls_(options_.channel),
        view_(&calls_, {}),
        previews_(&calls_) {}
  void Stop() override { server_->Stop(); }

  absl::Status Open() {
    rpc::HostAndPort where;
    if (absl::Status status = rpc::ParseHostAndPort(options_.address, &where); !status.ok()) return status;
    absl::StatusOr<sockets::ListeningSockets> listening = sockets::ListenAt(options_.address);
    if (!listening.ok()) return listening.status();
    listening_ = *std::move(listening);
    absl::StatusOr<std::unique_ptr<http::Server>> server =
        http::Server::Start({.listening = &listening_.sockets,
                             .certificate_path = options_.certificate_path,
                             .limits = {.body_bytes = kMaxPartBytes},
                             .headers = {{"Content-Security-Policy", kContentSecurityPolicy},
                                         {"X-Content-Type-Options", "nosniff"},
                                         {"Referrer-Policy", "no-referrer"},
                                         {"Cross-Origin-Opener-Policy", "same-origin"},
                                         {"Cross-Origin-Resource-Policy", "same-origin"},
                                         {"Cache-Control", "no-store"}},
                             .handler = [this](const Request& request) { return Answer(request); }});
    if (!server.ok()) return server.status();
    server_ = *std::move(server);
    return absl::OkStatus();
  }

  absl::StatusOr<v1::PageLink> MakeLink(const std::string& credential,
                                        const v1::CreatePageLinkRequest& request) const override {
    if (request.hours() < 0 || request.hours() > kMostHours)
      return absl::InvalidArgumentError(absl::StrCat("hours: 0 to ", kMostHours));
    const int hours = request.hours() == 0 ? kDefaultHours : request.hours();
    v1::PageSession session;
    session.set_credential(credential);
    session.set_job_id(request.job_id());
    session.set_expires_unix_ms(absl::ToUnixMillis(options_.wall_now() + absl::Hours(hours)));
    v1::PageLink link;
    link.set_scheme(Scheme());
    link.set_host(options_.host);
    link.set_port(listening_.port);
    link.set_loopback(rpc::IsLoopback(options_.address));
    link.set_session(seal_.Seal(session));
    link.set_expires_unix_ms(session.expires_unix_ms());
    return link;
  }
  int viewers() const override { return viewers_; }
  int port() const override { return listening_.port; }

 private:
  /// Answers a request of a valid session.
  using Handler = absl::StatusOr<Response> (StatusPageImpl::*)(const v1::PageSession&, const Request&);

  std::string Scheme() const { return options_.certificate_path.empty() ? "http" : "https"; }

  Response Answer(const Request& request) {
    const absl::string_view host = request.Header("Host");
    if (!IsOurHost(host, options_.names) || !IsOurOrigin(request.Header("Origin"), Scheme(), host))
      return ErrorResponse(
          absl::PermissionDeniedError("the request is for another server, or from another page"));
    const bool reads = request.method == "GET" || request.method == "HEAD";
    if (const WebFile* const file = FileAt(request.path); file != nullptr && reads)
      return {.content_type = std::string(TypeOf(file->name)), .body = std::string(file->content)};
    const absl::StatusOr<Response> answer = AnswerCaller(request, HandlerOf(request.path, request.method));
    return answer.ok() ? *answer : ErrorResponse(answer.status());
  }

  /// Null for what the page does not have.
  static Handler HandlerOf(absl::string_view path, absl::string_view method) {
    if (method == "POST" && path == "/api/ticket") return &StatusPageImpl::AnswerTicket;
    if (method == "POST") return absl::StartsWith(path, kCallPath) ? &StatusPageImpl::AnswerCall : nullptr;
    if (method == "PUT" && path == "/api/asset") return &StatusPageImpl::AnswerFor<AnswerUpload>;
    if (method != "GET" && method != "HEAD") return nullptr;
    if (path == "/api/session") return &StatusPageImpl::AnswerSession;
    if (path == "/api/events") return &StatusPageImpl::AnswerEvents;
    if (path == "/api/preview") return &StatusPageImpl::AnswerPreview;
    if (path == "/api/result") return &StatusPageImpl::AnswerFor<AnswerResult>;
    if (path == "/api/results") return &StatusPageImpl::AnswerFor<AnswerArchive>;
    return nullptr;
  }

  absl::StatusOr<Response> AnswerCaller(const Request& request, Handler handler) {
    if (handler == nullptr) return absl::NotFoundError("the page does not have this");
    absl::string_view token = request.Header("Authorization");
    const std::optional<std::string> ticket = request.Parameter("ticket");
    // What a browser saves as a file it fetches without headers of ours.
    const bool is_download = handler == Handler(&StatusPageImpl::AnswerFor<AnswerResult>) ||
                             handler == Handler(&StatusPageImpl::AnswerFor<AnswerArchive>);
    if (token.empty() && is_download && ticket.has_value()) {
      token = *ticket;
    } else if (!absl::ConsumePrefix(&token, "Bearer ")) {
      return absl::UnauthenticatedError("this page needs a link: 'lumifold page'");
    }
    const absl::StatusOr<v1::PageSession> session = SessionOf(token);
    if (!session.ok()) return session.status();
    return (this->*handler)(*session, request);
  }

  /// Of a link, or of a token of the farm, which programs have.
  absl::StatusOr<v1::PageSession> SessionOf(absl::string_view token) const {
    absl::StatusOr<v1::PageSession> session = seal_.Open(token, options_.wall_now());
    if (session.ok()) return session;
    if (options_.known == nullptr) return session;
    const absl::StatusOr<access::Credential> owner =
        options_.known->OfToken({token.data(), token.size()}, options_.wall_now());
    if (!owner.ok()) return session;
    session.emplace();
    session->set_credential(owner->identity().id);
    session->set_expires_unix_ms(std::numeric_limits<int64_t>::max());
    return session;
  }

  /// Who has a session's credential, empty for the local caller.
  /// Errors: kUnauthenticated where nobody has it any more.
  absl::StatusOr<access::Identity> IdentityOf(const std::string& credential) const {
    if (options_.known == nullptr || credential.empty()) return access::LocalIdentity();
    const absl::StatusOr<access::Credential> found =
        options_.known->OfValidId(credential, options_.wall_now());
    if (!found.ok()) return found.status();
    return found->identity();
  }

  absl::StatusOr<Response> AnswerSession(const v1::PageSession& session, const Request&) {
    const absl::StatusOr<access::Identity> caller = IdentityOf(session.credential());
    if (!caller.ok()) return caller.status();
    const std::map<access::Scope, std::string> names = {
        {access::Scope::kRead, "read"}, {access::Scope::kSubmit, "submit"}, {access::Scope::kAdmin, "admin"}};
    std::vector<std::string> scopes;
    for (const access::Scope scope : caller->scopes) scopes.push_back(names.at(scope));
    return JsonResponse({{"user", caller->name},
                         {"scopes", scopes},
                         {"job", session.job_id()},
                         {"read_only", !session.job_id().empty()},
                         {"expires_unix_ms", session.expires_unix_ms()},
                         {"version", std::string(rpc::kVersion)}});
  }

  absl::StatusOr<Response> AnswerCall(const v1::PageSession& session, const Request& request) {
    if (!absl::StartsWith(request.Header("Content-Type"), "application/json"))
      return absl::InvalidArgumentError("a call is sent as application/json");
    absl::StatusOr<std::string> json =
        calls_.CallInJson(session, request.path.substr(kCallPath.size()), request.body);
    if (!json.ok()) return json.status();
    return Response{.content_type = "application/json", .body = *std::move(json)};
  }

  /// A session for downloads of one job, for a URL: it changes nothing and ends soon.
  absl::StatusOr<Response> AnswerTicket(const v1::PageSession& session, const Request& request) {
    v1::PageSession ticket = session;
    if (ticket.job_id().empty()) ticket.set_job_id(request.Parameter("job").value_or(""));
    if (ticket.job_id().empty()) return absl::InvalidArgumentError("a ticket is for a job");
    const int64_t end = absl::ToUnixMillis(options_.wall_now() + kTicketTime);
    ticket.set_expires_unix_ms(std::min(end, session.expires_unix_ms()));
    return JsonResponse({{"ticket", seal_.Seal(ticket)}, {"expires_unix_ms", ticket.expires_unix_ms()}});
  }

  template <absl::StatusOr<Response> (*answer)(const FarmCalls&, const v1::PageSession&, const Request&)>
  absl::StatusOr<Response> AnswerFor(const v1::PageSession& session, const Request& request) {
    return answer(calls_, session, request);
  }

  absl::StatusOr<Response> AnswerPreview(const v1::PageSession& session, const Request& request) {
    v1::GetPreviewRequest wanted;
    wanted.set_job_id(request.Parameter("job").value_or(""));
    wanted.set_layer(request.Parameter("layer").value_or(""));
    int32_t frame = 0;
    int64_t newer = 0;
    const bool is_right = absl::SimpleAtoi(request.Parameter("frame").value_or("0"), &frame) &&
                          absl::SimpleAtoi(request.Parameter("newer").value_or("0"), &newer);
    if (!is_right) return absl::InvalidArgumentError("frame and newer are whole numbers");
    if (const std::optional<std::string> text = request.Parameter("region"); text.has_value()) {
      const std::optional<Rect> region = rpc::ParseRect(*text);
      if (!region.has_value()) return absl::InvalidArgumentError("region is x0,y0,x1,y1");
      *wanted.mutable_region() = rpc::ProtoOf(*region);
    }
    wanted.set_frame(frame);
    wanted.set_newer_than_units(newer);
    if (!session.job_id().empty() && session.job_id() != wanted.job_id())
      return absl::PermissionDeniedError("this link shows another job");
    const absl::StatusOr<SharedPreviews::Bytes> bytes = previews_.Get(session, wanted);
    if (absl::IsOutOfRange(bytes.status())) return Response{.status = 204};
    if (!bytes.ok()) return bytes.status();
    return Response{.content_type = "application/octet-stream",
                    .body = **bytes,
                    .headers = {{"Content-Encoding", "gzip"}}};
  }

  absl::StatusOr<Response> AnswerEvents(const v1::PageSession& session, const Request&) {
    const auto viewer = std::make_shared<Viewer>(&viewers_);
    if (viewers_ > options_.viewers) return absl::ResourceExhaustedError("too many browsers watch this page");
    return Response{.content_type = "text/event-stream",
                    .stream = [this, viewer, session] { return NextEvents(session, viewer.get()); },
                    .pause = kRound};
  }

  /// What has changed since the viewer's last look; nullopt: its session has ended.
  std::optional<std::string> NextEvents(const v1::PageSession& session, Viewer* viewer) {
    const absl::Time now = rpc::MonotonicNow();
    if (!SessionSeal::IsOpen(session, options_.wall_now())) return std::nullopt;
    const std::shared_ptr<const FarmLook> look = view_.Look(session);
    if (absl::IsUnauthenticated(look->status) || absl::IsNotFound(look->status)) return std::nullopt;
    std::string events = EventsSince(viewer->has, *look);
    viewer->has = look->number;
    if (events.empty() && now - viewer->last >= kPing) events = ": ping\n\n";
    if (!events.empty()) viewer->last = now;
    return events;
  }

  const StatusPageOptions options_;
  const SessionSeal seal_;
  const FarmCalls calls_;
  FarmView view_;
  SharedPreviews previews_;
  std::atomic<int> viewers_ = 0;
  sockets::ListeningSockets listening_;
  std::unique_ptr<http::Server> server_;  // last: its threads use the members above
};

}  // namespace

absl::StatusOr<std::unique_ptr<StatusPage>> StatusPage::Start(StatusPageOptions options) {
  auto page = std::make_unique<StatusPageImpl>(std::move(options));
  if (absl::Status status = page->Open(); !status.ok()) return status;
  return page;
}

}  // namespace lumifold::page
