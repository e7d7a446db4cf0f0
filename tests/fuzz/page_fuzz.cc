// Bytes that a browser, or what is none, sends to the status page.

#include <grpcpp/grpcpp.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <memory>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "google/protobuf/stubs/logging.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "server/page/page_session.h"
#include "server/page/status_page.h"
#include "tests/fuzz/fuzz_target.h"

namespace lumifold::fuzz {
namespace {

const absl::Time kNow = absl::FromUnixSeconds(1'700'000'000);
constexpr char kKey[] = "a key that no browser has";

/// A farm that knows one job.
class OneJob final : public v1::FarmService::Service {
 public:
  grpc::Status ListJobs(grpc::ServerContext*, const v1::ListJobsRequest*,
                        v1::ListJobsResponse* response) override {
    response->add_jobs()->set_job_id("j-1");
    return grpc::Status::OK;
  }
  grpc::Status GetPreview(grpc::ServerContext*, const v1::GetPreviewRequest*, v1::Preview*) override {
    return {grpc::StatusCode::OUT_OF_RANGE, "nothing yet"};
  }
  grpc::Status CancelJob(grpc::ServerContext*, const v1::CancelJobRequest* request,
                         v1::JobStatus* response) override {
    response->set_job_id(request->job_id());
    return grpc::Status::OK;
  }
};

/// A status page on a socket of its own, made once.
class Fixture {
 public:
  Fixture() {
    grpc::ServerBuilder builder;
    builder.RegisterService(&farm_);
    server_ = builder.BuildAndStart();
    absl::StatusOr<std::unique_ptr<page::StatusPage>> started =
        page::StatusPage::Start({.address = "127.0.0.1:0",
                                 .certificate_path = "",
                                 .host = "127.0.0.1",
                                 .names = {},
                                 .channel = server_->InProcessChannel({}),
                                 .session_key = kKey,
                                 .wall_now = [] { return kNow; }});
    if (!started.ok()) Fail("cannot start", std::string(started.status().message()));
    page_ = *std::move(started);
    v1::PageSession session;
    session.set_expires_unix_ms(absl::ToUnixMillis(kNow + absl::Hours(1)));
    session_ = page::SessionSeal(kKey).Seal(session);
  }

  const std::string& session() const { return session_; }
  int port() const { return page_->port(); }

 private:
  OneJob farm_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<page::StatusPage> page_;
  std::string session_;
};

Fixture& TheFixture() {
  static Fixture fixture;
  return fixture;
}

/// The first bytes of the answer to a connection that sends these and no more; empty without an answer.
std::string AnswerTo(absl::string_view request) {
  const int connection = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const timeval patience = {.tv_sec = 20, .tv_usec = 0};
  setsockopt(connection, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(TheFixture().port()));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (connect(connection, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
    Fail("no connection", "the page does not accept any more");
  (void)send(connection, request.data(), request.size(), MSG_NOSIGNAL);
  shutdown(connection, SHUT_WR);
  std::string answer(4096, '\0');
  const ssize_t received = recv(connection, answer.data(), answer.size(), 0);
  if (received < 0 && errno == EAGAIN) Fail("no end of", std::string(request));
  answer.resize(received < 0 ? 0 : static_cast<size_t>(received));
  close(connection);
  return answer;
}

void TryRequest(absl::string_view request) {
  const std::string answer = AnswerTo(request);
  if (!answer.empty() && !absl::StartsWith(answer, "HTTP/1.")) Fail("no HTTP", answer);
  const bool tells = absl::StartsWith(answer, "HTTP/1.1 200") && !absl::StrContains(answer, "javascript") &&
                     !absl::StrContains(answer, "text/html") && !absl::StrContains(answer, "text/css");
  if (tells && !absl::StrContains(request, TheFixture().session()))
    Fail("an answer without a session", absl::StrCat(request, answer));
}

}  // namespace

std::vector<std::string> Seeds() {
  google::protobuf::SetLogHandler(nullptr);  // it would print a line for each text that is not UTF-8
  const std::string head =
      absl::StrCat("Host: 127.0.0.1\r\nAuthorization: Bearer ", TheFixture().session(), "\r\n");
  const auto get = [&head](const char* path) {
    return absl::StrCat("GET ", path, " HTTP/1.1\r\n", head, "\r\n");
  };
  const auto post = [&head](const char* method, const std::string& body) {
    return absl::StrCat("POST /api/call/", method, " HTTP/1.1\r\n", head,
                        "Content-Type: application/json\r\nContent-Length: ", body.size(), "\r\n\r\n", body);
  };
  return {get("/"),
          get("/app.js"),
          get("/api/session"),
          get("/api/events"),
          get("/api/preview?job=j-1&frame=0&layer=noisy&newer=7"),
          get("/api/preview?job=j-1&region=0,0,16,9"),
          post("CancelJob", R"({"job_id":"j-1"})"),
          post("ListJobs", R"({"page_size":5,"states":["JOB_STATE_RUNNING"]})"),
          "POST /api/call/ListJobs HTTP/1.1\r\n" + head +
              "Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n",
          "GET /api/session HTTP/1.1\r\nHost: evil.example\r\nOrigin: https://evil.example\r\n\r\n"};
}

}  // namespace lumifold::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  lumifold::fuzz::TryRequest({reinterpret_cast<const char*>(data), size});
  return 0;
}
