// The page over HTTP, with a farm of the test behind it: what each request asks the farm for, and how each of
// the farm's answers is told.
#include "server/page/status_page.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "proto/identity/secrets.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/checksum.h"

namespace lumifold::page {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

/// Answers as the test says, and keeps what it was asked.
class ScriptedFarm final : public v1::FarmService::Service {
 public:
  grpc::Status GetJob(grpc::ServerContext*, const v1::GetJobRequest* request,
                      v1::JobStatus* response) override {
    *response = job;
    response->set_job_id(request->job_id());
    return status;
  }
  grpc::Status UploadAsset(grpc::ServerContext*, grpc::ServerReader<v1::UploadAssetRequest>* reader,
                           v1::UploadAssetResponse*) override {
    v1::UploadAssetRequest message;
    while (reader->Read(&message)) uploaded.push_back(message);
    return status;
  }
  grpc::Status FindUpload(grpc::ServerContext*, const v1::FindUploadRequest* request,
                          v1::FindUploadResponse* response) override {
    asked_about = request->asset();
    response->set_received_bytes(received);
    return grpc::Status::OK;
  }
  grpc::Status GetPreview(grpc::ServerContext*, const v1::GetPreviewRequest* request, v1::Preview*) override {
    preview = *request;
    return {grpc::StatusCode::OUT_OF_RANGE, "nothing newer"};
  }
  grpc::Status DownloadResult(grpc::ServerContext*, const v1::DownloadResultRequest* request,
                              grpc::ServerWriter<v1::ByteChunk>* writer) override {
    downloads.push_back(*request);
    if (request->frame() == unfinished) return {grpc::StatusCode::FAILED_PRECONDITION, "not finished"};
    const std::string rest = absl::StrCat("frame ", request->frame(), "!").substr(request->offset());
    v1::ByteChunk chunk;
    chunk.set_total_size(rest.size() + request->offset());
    chunk.set_sha256(std::string(62, '0') + "ff");
    for (const std::string& data : {rest.substr(0, 3), rest.substr(3)}) {
      chunk.set_data(data);
      writer->Write(chunk);
    }
    return grpc::Status::OK;
  }

  v1::JobStatus job;
  grpc::Status status;
  std::vector<v1::UploadAssetRequest> uploaded;
  v1::AssetRef asked_about;
  uint64_t received = 0;
  v1::GetPreviewRequest preview;
  std::vector<v1::DownloadResultRequest> downloads;
  int unfinished = -1;
};

struct Answer {
  int code = 0;
  std::string head;
  std::string body;
  nlohmann::json json() const { return nlohmann::json::parse(body); }
};

/// The one whose secret is "secret of ID".
access::NewCredential TokenOf(const std::string& id) {
  return {.credential = {.id = id,
                         .form = access::CredentialForm::kToken,
                         .name = "of " + id,
                         .scopes = {access::Scope::kRead, access::Scope::kSubmit},
                         .token_lifetime = absl::ZeroDuration(),
                         .created = absl::InfinitePast(),
                         .expires = absl::InfiniteFuture()},
          .sha256 = identity::HashOf("secret of " + id)};
}

class StatusPageTest : public ::testing::Test {
 protected:
  StatusPageTest() {
    for (const char* id : {"t-1", "t-7"}) known_.Add(TokenOf(id));
    access::NewCredential gone = TokenOf("t-gone");
    gone.credential.end = access::Credential::End::kRevoked;
    known_.Add(gone);
    grpc::ServerBuilder builder;
    builder.RegisterService(&farm_);
    server_ = builder.BuildAndStart();
    absl::StatusOr<std::unique_ptr<StatusPage>> page =
        StatusPage::Start({.address = "127.0.0.1:0",
                           .certificate_path = "",
                           .host = "farm.example",
                           .names = {},
                           .channel = server_->InProcessChannel({}),
                           .session_key = "secret",
                           .known = &known_,
                           .wall_now = [this] { return now_; },
                           .viewers = 2});
    EXPECT_TRUE(page.ok()) << page.status();
    page_ = *std::move(page);
  }

  std::string Link(const std::string& job = "", int hours = 1) {
    v1::CreatePageLinkRequest request;
    request.set_job_id(job);
    request.set_hours(hours);
    return page_->MakeLink("t-1", request)->session();
  }

  /// A connection over which `text` has been sent.
  rpc::FileHandle Send(const std::string& text) const {
    rpc::FileHandle caller(socket(AF_INET, SOCK_STREAM, 0));
    if (caller.get() < 0) ADD_FAILURE() << "no socket";
    if (caller.get() < 0) return caller;
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<uint16_t>(page_->port()));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(connect(caller.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    EXPECT_EQ(send(caller.get(), text.data(), text.size(), MSG_NOSIGNAL), static_cast<ssize_t>(text.size()));
    return caller;
  }

  /// `line`: METHOD TARGET; `headers`: further ones, each with its end of line.
  Answer Ask(const std::string& line, const std::string& headers = "", const std::string& body = "") const {
    const rpc::FileHandle caller = Send(absl::StrCat(
        line, " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Length: ", body.size(), "\r\n",
        headers, "\r\n", body));
    std::string all;
    char buffer[4096];
    for (ssize_t n = 0; (n = recv(caller.get(), buffer, sizeof buffer, 0)) > 0;)
      all.append(buffer, static_cast<size_t>(n));
    Answer answer;
    const size_t end = all.find("\r\n\r\n");
    EXPECT_NE(end, std::string::npos) << all;
    if (end == std::string::npos) return answer;
    answer.head = all.substr(0, end + 2);
    answer.body = all.substr(end + 4);
    answer.code = std::stoi(all.substr(all.find(' ') + 1, 3));
    return answer;
  }
  Answer AskAs(const std::string& session, const std::string& line, const std::string& body = "") const {
    return Ask(line, absl::StrCat("Authorization: Bearer ", session, "\r\n"), body);
  }
  Answer GetJob(const std::string& session) const {
    return Ask("POST /api/call/GetJob",
               absl::StrCat("Authorization: Bearer ", session, "\r\nContent-Type: application/json\r\n"),
               R"({"job_id":"j-1"})");
  }

  ScriptedFarm farm_;
  access::KnownCredentials known_;
  std::unique_ptr<grpc::Server> server_;
  absl::Time now_ = absl::FromUnixSeconds(1'000'000);
  std::unique_ptr<StatusPage> page_;
};

TEST_F(StatusPageTest, EachErrorOfTheFarmHasItsCode) {
  const std::vector<int> codes = {0,   503, 500, 400, 503, 404, 409, 403, 429,
                                  409, 409, 400, 500, 500, 503, 500, 401};
  for (int code = 1; code < static_cast<int>(codes.size()); ++code) {
    farm_.status = {static_cast<grpc::StatusCode>(code), absl::StrCat("reason ", code)};
    const Answer answer = GetJob(Link());
    EXPECT_EQ(answer.code, codes[static_cast<size_t>(code)]) << code;
    const nlohmann::json error = answer.json().at("error");
    EXPECT_EQ(error.at("code"), absl::StatusCodeToString(static_cast<absl::StatusCode>(code)));
    EXPECT_EQ(error.at("message"), absl::StrCat("reason ", code));
  }
  farm_.status = grpc::Status::OK;
  EXPECT_EQ(GetJob(Link()).json().at("job_id"), "j-1");
}

TEST_F(StatusPageTest, EachPathHasItsMethods) {
  const std::string session = Link();
  const std::vector<std::pair<std::string, int>> codes = {{"GET /", 200},
                                                          {"HEAD /", 200},
                                                          {"POST /", 404},
                                                          {"GET /none", 404},
                                                          {"POST /api/ticket", 400},
                                                          {"GET /api/ticket", 404},
                                                          {"PUT /api/asset", 400},
                                                          {"POST /api/asset", 404},
                                                          {"GET /api/session", 200},
                                                          {"HEAD /api/session", 200},
                                                          {"PUT /api/session", 404},
                                                          {"GET /api/preview?frame=x", 400},
                                                          {"GET /api/preview?newer=x", 400},
                                                          {"GET /api/preview?region=1", 400},
                                                          {"GET /api/result?frame=x", 400},
                                                          {"POST /api/call/Nothing", 400},
                                                          {"DELETE /api/result", 404}};
  for (const auto& [line, code] : codes) EXPECT_EQ(AskAs(session, line).code, code) << line;
  EXPECT_THAT(Ask("GET /").head, AllOf(HasSubstr("Content-Type: text/html"),
                                       HasSubstr("Content-Security-Policy: default-src 'none'"),
                                       HasSubstr("Cache-Control: no-store")));
  EXPECT_EQ(Ask("GET /", "Origin: http://evil.example\r\n").code, 403);
}

TEST_F(StatusPageTest, ALinkSaysWhereThePageIsAndUntilWhen) {
  v1::CreatePageLinkRequest request;
  const v1::PageLink link = *page_->MakeLink("t-1", request);
  EXPECT_EQ(link.scheme(), "http");
  EXPECT_EQ(link.host(), "farm.example");
  EXPECT_EQ(link.port(), page_->port());
  EXPECT_TRUE(link.loopback());
  EXPECT_EQ(link.expires_unix_ms(), absl::ToUnixMillis(now_ + absl::Hours(12)));
  for (const auto& [hours, is_ok] : {std::pair(-1, false), {1, true}, {720, true}, {721, false}}) {
    request.set_hours(hours);
    const absl::StatusOr<v1::PageLink> made = page_->MakeLink("t-1", request);
    EXPECT_EQ(made.ok(), is_ok) << hours;
    if (made.ok()) {
      EXPECT_EQ(made->expires_unix_ms(), absl::ToUnixMillis(now_ + absl::Hours(hours)));
    }
  }
}

TEST_F(StatusPageTest, ASessionIsThatOfALinkUntilItsEndOrOfAToken) {
  const std::string session = Link("j-1");
  const nlohmann::json of_link = AskAs(session, "GET /api/session").json();
  EXPECT_EQ(of_link.at("user"), "of t-1");
  EXPECT_EQ(of_link.at("scopes"), nlohmann::json({"read", "submit"}));
  EXPECT_EQ(of_link.at("job"), "j-1");
  EXPECT_EQ(of_link.at("read_only"), true);
  EXPECT_EQ(of_link.at("expires_unix_ms"), absl::ToUnixMillis(now_ + absl::Hours(1)));
  const nlohmann::json of_token = AskAs("secret of t-7", "GET /api/session").json();
  EXPECT_EQ(of_token.at("user"), "of t-7");
  EXPECT_EQ(of_token.at("read_only"), false);
  EXPECT_EQ(AskAs("another", "GET /api/session").code, 401);
  EXPECT_EQ(Ask("GET /api/session").code, 401);
  EXPECT_EQ(Ask("GET /api/session", absl::StrCat("Authorization: Basic ", session, "\r\n")).code, 401);
  now_ += absl::Hours(1) - absl::Milliseconds(1);
  EXPECT_EQ(AskAs(session, "GET /api/session").code, 200);
  now_ += absl::Milliseconds(1);
  EXPECT_EQ(AskAs(session, "GET /api/session").code, 401);
}

TEST_F(StatusPageTest, ATicketDownloadsOneJobForAMinute) {
  farm_.job.set_frame_count(1);
  const nlohmann::json made = AskAs(Link(), "POST /api/ticket?job=j-1").json();
  EXPECT_EQ(made.at("expires_unix_ms"), absl::ToUnixMillis(now_ + absl::Minutes(1)));
  const std::string ticket = made.at("ticket");
  EXPECT_EQ(Ask("GET /api/result?job=j-1&ticket=" + ticket).body, "frame 0!");
  EXPECT_EQ(Ask("GET /api/results?job=j-1&ticket=" + ticket).code, 200);
  EXPECT_EQ(Ask("GET /api/result?job=j-2&ticket=" + ticket).code, 403);
  EXPECT_EQ(Ask("GET /api/session?ticket=" + ticket).code, 401) << "it is for downloads";
  EXPECT_EQ(AskAs(Link(), "POST /api/ticket").code, 400) << "of no job";
  EXPECT_EQ(AskAs(Link("j-1"), "POST /api/ticket?job=j-2").code, 200);
  const std::string session = Link("j-1");
  now_ += absl::Minutes(59.5);
  EXPECT_EQ(AskAs(session, "POST /api/ticket").json().at("expires_unix_ms"),
            absl::ToUnixMillis(now_ + absl::Seconds(30)))
      << "not after the session's end";
}

TEST_F(StatusPageTest, APartOfAnAssetIsSentOnAndWhatHasArrivedIsTold) {
  const std::string put = "PUT /api/asset?sha256=abc&size=10&offset=4";
  EXPECT_EQ(AskAs(Link(), put, "456").body, R"({"received_bytes":10,"complete":true})");
  ASSERT_EQ(farm_.uploaded.size(), 2u);
  EXPECT_EQ(farm_.uploaded[0].announce().sha256(), "abc");
  EXPECT_EQ(farm_.uploaded[0].announce().size(), 10u);
  const v1::ByteChunk& chunk = farm_.uploaded[1].chunk();
  EXPECT_EQ(chunk.offset(), 4u);
  EXPECT_EQ(chunk.data(), "456");
  EXPECT_EQ(chunk.checksum(), rpc::Checksum("456"));
  EXPECT_EQ(chunk.total_size(), 10u);

  farm_.status = {grpc::StatusCode::DATA_LOSS, "more is missing"};
  farm_.received = 7;
  EXPECT_EQ(AskAs(Link(), put, "456").body, R"({"received_bytes":7,"complete":false})");
  EXPECT_EQ(farm_.asked_about.sha256(), "abc");
  EXPECT_EQ(farm_.asked_about.size(), 10u);
  EXPECT_EQ(AskAs(Link(), put, "456789").code, 500) << "nothing is missing: the content is another one";
  farm_.received = 4;
  EXPECT_EQ(AskAs(Link(), put, "456").code, 500) << "nothing of it was kept";
  farm_.status = {grpc::StatusCode::ABORTED, "the bytes before it are gone"};
  EXPECT_EQ(AskAs(Link(), put, "456").code, 409);
  EXPECT_EQ(AskAs(Link("j-1"), put, "456").code, 403);
  for (const char* query : {"", "?size=x", "?size=1&offset=x", "?offset=1"})
    EXPECT_EQ(AskAs(Link(), absl::StrCat("PUT /api/asset", query)).code, 400) << query;
}

TEST_F(StatusPageTest, AFrameIsDownloadedFromAnyByte) {
  farm_.job.set_display_name("shot 7.glb");
  farm_.job.set_first_frame(5);
  farm_.job.set_frames_total(2);
  const Answer whole = AskAs(Link(), "GET /api/result?job=j-1");
  EXPECT_EQ(whole.body, "frame 5!");
  EXPECT_THAT(whole.head, AllOf(HasSubstr("200 OK"), HasSubstr("Content-Length: 8\r\n"),
                                HasSubstr("Content-Type: image/x-exr\r\n"),
                                HasSubstr("filename=\"shot_7.0005.exr\""), Not(HasSubstr("Content-Range")),
                                HasSubstr("Repr-Digest: sha-256=:" + std::string(41, 'A') + "P8=:")));
  farm_.job.set_frames_total(1);
  const Answer rest = Ask("GET /api/result?job=j-1&frame=6",
                          absl::StrCat("Authorization: Bearer ", Link(), "\r\nRange: bytes=3-\r\n"));
  EXPECT_EQ(rest.body, "me 6!");
  EXPECT_THAT(rest.head, AllOf(HasSubstr("206 "), HasSubstr("Content-Range: bytes 3-7/8\r\n"),
                               HasSubstr("Content-Length: 5\r\n"), HasSubstr("\"shot_7.exr\"")));
  EXPECT_EQ(farm_.downloads.back().job_id(), "j-1");
  farm_.unfinished = 5;
  EXPECT_EQ(AskAs(Link(), "GET /api/result?job=j-1").code, 409);
}

TEST_F(StatusPageTest, AnArchiveHasTheFinishedFramesOfAllRanges) {
  farm_.job.set_first_frame(5);
  farm_.job.set_frame_count(2);
  farm_.job.set_frames_total(4);
  v1::FrameRange* const more = farm_.job.add_more_frames();
  more->set_first(20);
  more->set_count(2);
  farm_.unfinished = 6;
  const Answer answer = AskAs(Link(), "GET /api/results?job=j-1");
  EXPECT_THAT(answer.head, HasSubstr("filename=\"picture.zip\""));
  for (const int frame : {5, 20, 21})
    EXPECT_THAT(answer.body,
                AllOf(HasSubstr(absl::StrCat("me ", frame, "!")),
                      HasSubstr(absl::StrCat("picture.00", frame < 10 ? "0" : "", frame, ".exr"))));
  EXPECT_EQ(farm_.downloads.size(), 4u);
  farm_.job.clear_more_frames();
  farm_.job.set_first_frame(6);
  farm_.job.set_frame_count(1);
  EXPECT_EQ(AskAs(Link(), "GET /api/results?job=j-1").code, 409) << "no frame of it is finished";
}

TEST_F(StatusPageTest, APreviewIsAskedForAsTheRequestSays) {
  EXPECT_EQ(AskAs(Link(), "GET /api/preview?job=j-1&frame=3&layer=noisy&newer=40&region=1,2,30,40").code,
            204);
  EXPECT_EQ(farm_.preview.ShortDebugString(),
            "job_id: \"j-1\" frame: 3 layer: \"noisy\" newer_than_units: 40 "
            "region { x0: 1 y0: 2 x1: 30 y1: 40 }");
  EXPECT_EQ(AskAs(Link("j-1"), "GET /api/preview?job=j-1").code, 204);
  EXPECT_EQ(AskAs(Link("j-1"), "GET /api/preview?job=j-2").code, 403);
}

TEST_F(StatusPageTest, NoMoreBrowsersWatchThanAreAllowed) {
  const std::string watch = absl::StrCat(
      "GET /api/events HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer ", Link("j-1"), "\r\n\r\n");
  std::vector<rpc::FileHandle> watching;
  for (int i = 0; i < 2; ++i) {
    watching.push_back(Send(watch));
    std::string begin;
    char buffer[1024];
    while (!absl::StrContains(begin, "event: jobs")) {
      const ssize_t n = recv(watching.back().get(), buffer, sizeof buffer, 0);
      ASSERT_GT(n, 0) << begin;
      begin.append(buffer, static_cast<size_t>(n));
    }
    EXPECT_EQ(page_->viewers(), i + 1);
  }
  EXPECT_EQ(AskAs(Link("j-1"), "GET /api/events").code, 429);
  EXPECT_EQ(page_->viewers(), 2);
}

TEST_F(StatusPageTest, WhoseCredentialIsGoneSeesNothing) {
  const v1::PageLink link = *page_->MakeLink("t-gone", {});
  EXPECT_EQ(AskAs(link.session(), "GET /api/session").code, 401);
}

}  // namespace
}  // namespace lumifold::page
