#include "server/page/status_page.h"

#include <atomic>
#include <map>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/rect_codec.h"
#include "proto/rpc/version.h"
#include "server/page/farm_calls.h"
#include "server/page/farm_view.h"
#include "server/page/page_session.h"
#include "server/page/request_checks.h"
#include "server/page/shared_previews.h"
#include "server/page/web_files.h"

namespace lumifold::page {
namespace {

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

void AnswerJson(const nlohmann::ordered_json& json, httplib::Response* answer) {
  // Texts of others may be no UTF-8.
  answer->set_content(json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace),
                      "application/json");
}

void AnswerError(const absl::Status& status, httplib::Response* answer) {
  answer->status = HttpCodeOf(status);
  AnswerJson(
      {{"error",
        {{"code", absl::StatusCodeToString(status.code())}, {"message", std::string(status.message())}}}},
      answer);
}

std::string_view TypeOf(std::string_view name) {
  static const auto& types =
      *new std::map<std::string_view, std::string_view>{{"html", "text/html; charset=utf-8"},
                                                        {"js", "text/javascript; charset=utf-8"},
                                                        {"css", "text/css; charset=utf-8"},
                                                        {"svg", "image/svg+xml"}};
  return types.at(name.substr(name.rfind('.') + 1));
}

class StatusPageImpl final : public StatusPage {
 public:
  explicit StatusPageImpl(StatusPageOptions options)
      : options_(std::move(options)),
        seal_(options_.session_key),
        calls_(options_.channel),
        view_(&calls_, {}),
        previews_(&calls_),
        server_(options_.server) {}
  ~StatusPageImpl() override { StatusPageImpl::Stop(); }
  void Stop() override {
    stop_.Notify();
    server_.Stop();
  }

  absl::Status Open() {
    SetHeaders();
    AddFiles();
    AddCalls();
    return server_.Start();
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
    link.set_port(server_.port());
    link.set_loopback(rpc::IsLoopback(options_.server.address));
    link.set_session(seal_.Seal(session));
    link.set_expires_unix_ms(session.expires_unix_ms());
    return link;
  }
  int viewers() const override { return viewers_; }
  int port() const override { return server_.port(); }

 private:
  using Request = httplib::Request;
  using Response = httplib::Response;
  /// Handles a request of a valid session.
  using Handler = std::function<absl::Status(const v1::PageSession&, const Request&, Response*)>;

  std::string Scheme() const { return server_.uses_tls() ? "https" : "http"; }

  void SetHeaders() {
    server_.set_default_headers({{"Content-Security-Policy", kContentSecurityPolicy},
                                 {"X-Content-Type-Options", "nosniff"},
                                 {"Referrer-Policy", "no-referrer"},
                                 {"Cross-Origin-Opener-Policy", "same-origin"},
                                 {"Cross-Origin-Resource-Policy", "same-origin"},
                                 {"Cache-Control", "no-store"}});
    server_.set_pre_routing_handler([this](const Request& request, Response& answer) {
      const bool ours =
          IsOurHost(request.get_header_value("Host"), options_.names) &&
          IsOurOrigin(request.get_header_value("Origin"), Scheme(), request.get_header_value("Host"));
      if (ours) return httplib::Server::HandlerResponse::Unhandled;
      AnswerError(absl::PermissionDeniedError("the request is for another server, or from another page"),
                  &answer);
      return httplib::Server::HandlerResponse::Handled;
    });
    server_.set_exception_handler([](const Request&, Response& answer, const std::exception_ptr&) {
      AnswerError(absl::InternalError("the page failed"), &answer);
    });
  }

  void AddFiles() {
    for (const WebFile& file : WebFiles()) {
      const std::string name(file.name);
      const auto handler = [&file](const Request&, Response& answer) {
        answer.set_content(file.content.data(), file.content.size(),
                           std::string(TypeOf({file.name.data(), file.name.size()})));
      };
      server_.Get(absl::StrCat("/", absl::StrReplaceAll(name, {{".", "\\."}})), handler);
      if (name == "index.html") server_.Get("/", handler);
    }
  }

  void AddCalls() {
    Get("/api/session", [this](const v1::PageSession& session, const Request&, Response* answer) {
      return AnswerSession(session, answer);
    });
    Get("/api/events", [this](const v1::PageSession& session, const Request&, Response* answer) {
      return AnswerEvents(session, answer);
    });
    Get("/api/preview", [this](const v1::PageSession& session, const Request& request, Response* answer) {
      return AnswerPreview(session, request, answer);
    });
    server_.Post("/api/call/([A-Za-z]+)", [this](const Request& request, Response& answer) {
      Handle(request, &answer, [this](const v1::PageSession& session, const Request& sent, Response* to) {
        return AnswerCall(session, sent, to);
      });
    });
  }

  void Get(const std::string& path, const Handler& handler) {
    server_.Get(path, [this, handler](const Request& request, Response& answer) {
      Handle(request, &answer, handler);
    });
  }

  void Handle(const Request& request, Response* answer, const Handler& handler) const {
    absl::string_view token = request.headers.count("Authorization") == 0
                                  ? absl::string_view()
                                  : absl::string_view(request.headers.find("Authorization")->second);
    absl::StatusOr<v1::PageSession> session =
        absl::UnauthenticatedError("this page needs a link: 'lumifold page'");
    if (absl::ConsumePrefix(&token, "Bearer ")) session = seal_.Open(token, options_.wall_now());
    const absl::Status status = session.ok() ? handler(*session, request, answer) : session.status();
    if (!status.ok()) AnswerError(status, answer);
  }

  absl::Status AnswerSession(const v1::PageSession& session, Response* answer) const {
    const absl::StatusOr<access::Identity> caller = options_.identity_of(session.credential());
    if (!caller.ok()) return caller.status();
    const std::map<access::Scope, std::string> names = {
        {access::Scope::kRead, "read"}, {access::Scope::kSubmit, "submit"}, {access::Scope::kAdmin, "admin"}};
    std::vector<std::string> scopes;
    for (const access::Scope scope : caller->scopes) scopes.push_back(names.at(scope));
    AnswerJson({{"user", caller->name},
                {"scopes", scopes},
                {"job", session.job_id()},
                {"read_only", !session.job_id().empty()},
                {"expires_unix_ms", session.expires_unix_ms()},
                {"version", std::string(rpc::kVersion)}},
               answer);
    return absl::OkStatus();
  }

  absl::Status AnswerCall(const v1::PageSession& session, const Request& request, Response* answer) const {
    if (!absl::StartsWith(request.get_header_value("Content-Type"), "application/json"))
      return absl::InvalidArgumentError("a call is sent as application/json");
    const absl::StatusOr<std::string> json = calls_.CallInJson(session, request.matches[1], request.body);
    if (!json.ok()) return json.status();
    answer->set_content(*json, "application/json");
    return absl::OkStatus();
  }

  absl::Status AnswerPreview(const v1::PageSession& session, const Request& request, Response* answer) {
    v1::GetPreviewRequest wanted;
    wanted.set_job_id(request.get_param_value("job"));
    wanted.set_layer(request.get_param_value("layer"));
    int32_t frame = 0;
    int64_t newer = 0;
    const bool is_right =
        (!request.has_param("frame") || absl::SimpleAtoi(request.get_param_value("frame"), &frame)) &&
        (!request.has_param("newer") || absl::SimpleAtoi(request.get_param_value("newer"), &newer));
    if (!is_right) return absl::InvalidArgumentError("frame and newer are whole numbers");
    if (request.has_param("region")) {
      const std::optional<Rect> region = rpc::ParseRect(request.get_param_value("region"));
      if (!region.has_value()) return absl::InvalidArgumentError("region is x0,y0,x1,y1");
      *wanted.mutable_region() = rpc::ProtoOf(*region);
    }
    wanted.set_frame(frame);
    wanted.set_newer_than_units(newer);
    if (!session.job_id().empty() && session.job_id() != wanted.job_id())
      return absl::PermissionDeniedError("this link shows another job");
    const absl::StatusOr<SharedPreviews::Bytes> bytes = previews_.Get(session, wanted);
    if (absl::IsOutOfRange(bytes.status())) {
      answer->status = 204;
      return absl::OkStatus();
    }
    if (!bytes.ok()) return bytes.status();
    answer->set_header("Content-Encoding", "gzip");
    answer->set_content_provider((*bytes)->size(), "application/octet-stream",
                                 [bytes = *bytes](size_t offset, size_t length, httplib::DataSink& sink) {
                                   return sink.write(bytes->data() + offset, length);
                                 });
    return absl::OkStatus();
  }

  absl::Status AnswerEvents(const v1::PageSession& session, Response* answer) {
    if (viewers_ >= options_.viewers)
      return absl::ResourceExhaustedError("too many browsers watch this page");
    ++viewers_;
    struct Viewer {
      uint64_t has = 0;
      absl::Time last = absl::InfinitePast();
    };
    const auto viewer = std::make_shared<Viewer>();
    answer->set_chunked_content_provider(
        "text/event-stream",
        [this, viewer, session](size_t, httplib::DataSink& sink) {
          const absl::Time now = rpc::MonotonicNow();
          const bool is_first = viewer->has == 0;
          if (!is_first && stop_.WaitFor(kRound)) return false;
          if (!SessionSeal::IsOpen(session, options_.wall_now())) return false;
          const std::shared_ptr<const FarmLook> look = view_.Look(session);
          if (absl::IsUnauthenticated(look->status) || absl::IsNotFound(look->status)) return false;
          std::string events = EventsSince(viewer->has, *look);
          viewer->has = look->number;
          if (events.empty() && now - viewer->last < kPing) return true;
          if (events.empty()) events = ": ping\n\n";
          viewer->last = now;
          return sink.write(events.data(), events.size());
        },
        [this](bool) { --viewers_; });
    return absl::OkStatus();
  }

  const StatusPageOptions options_;
  const SessionSeal seal_;
  const FarmCalls calls_;
  FarmView view_;
  SharedPreviews previews_;
  rpc::MonotonicEvent stop_;
  std::atomic<int> viewers_ = 0;
  WebServer server_;  // last: its threads use the members above
};

}  // namespace

absl::StatusOr<std::unique_ptr<StatusPage>> StatusPage::Start(StatusPageOptions options) {
  auto page = std::make_unique<StatusPageImpl>(std::move(options));
  if (absl::Status status = page->Open(); !status.ok()) return status;
  return page;
}

}  // namespace lumifold::page
