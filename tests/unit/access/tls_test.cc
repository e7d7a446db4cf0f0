// Access control over real TLS connections.

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/file_io.h"
#include "lumifold/v1/access.grpc.pb.h"
#include "proto/identity/join.h"
#include "proto/identity/pinned_ca.h"
#include "proto/identity/profile.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/status_codec.h"
#include "server/access/authorisation.h"
#include "server/access/caller_check.h"
#include "server/services/access_service.h"
#include "server/services/call_gate.h"
#include "tests/unit/access/access_fixture.h"

namespace lumifold::access {
namespace {

using ::testing::HasSubstr;

class TlsTest : public AccessFixture {
 protected:
  TlsTest() {
    now_ = absl::Now();  // OpenSSL checks certificates by the machine's clock
    access_.reset();
    std::filesystem::remove_all(Options().folder);
    EXPECT_TRUE(MakeAccessFolder(Options(), {}).ok());
    Open();
    callers_ = MakeCallers(&access_->known(), Options().wall_now);
    gate_ = std::make_unique<server::CallGate>(GateOptions(callers_.get()));
    service_ = server::MakeAccessService(access_.get(), gate_.get());
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort(
        "127.0.0.1:0",
        rpc::MakeServerCredentials(
            access_->security(),
            MakeCallerCheck(&access_->known(), authoriser_.get(), Options().wall_now,
                            [this](const Identity& caller, absl::string_view rpc_path,
                                   const absl::Status& why) { gate_->NoteRefusal(caller, rpc_path, why); })),
        &port);
    builder.RegisterService(service_.get());
    server_ = builder.BuildAndStart();
    address_ = absl::StrCat("127.0.0.1:", port);
  }

  std::string Code(v1::HolderKind kind, const std::string& name) {
    v1::CreateInviteRequest request;
    request.set_kind(kind);
    request.set_name(name);
    if (kind == v1::HOLDER_KIND_PERSON) request.add_scopes(v1::ACCESS_SCOPE_READ);
    return access_->CreateInvite(LocalIdentity(), request)->code();
  }
  std::string LogIn(const std::string& name) {
    const auto response = identity::Login(profiles_, name, address_, Code(v1::HOLDER_KIND_PERSON, name));
    EXPECT_TRUE(response.ok()) << response.status();
    return response.ok() ? response->token() : "";
  }
  static absl::StatusOr<std::string> NameOver(const std::shared_ptr<grpc::Channel>& channel,
                                              grpc::ClientContext& context) {
    v1::AccessService::Stub stub(channel);
    v1::WhoAmIResponse response;
    const absl::Status status = rpc::StatusFromGrpc(stub.WhoAmI(&context, {}, &response));
    if (!status.ok()) return status;
    return response.name();
  }
  absl::StatusOr<std::string> NameWith(const rpc::Security& security) {
    grpc::ClientContext context;
    return NameOver(rpc::MakeChannel(address_, security), context);
  }

  server::CallGate::Options GateOptions(const Callers* callers) {
    return {.callers = callers,
            .open_calls = &access_->open_calls(),
            .audit = audit_.get(),
            .limits = {.requests_per_second = 1, .request_burst = 20},
            .now = [this] { return now_; },
            .wall_now = Options().wall_now};
  }
  /// Once the log is closed, so that all of it is written.
  std::string AuditText() {
    server_.reset();
    gate_.reset();
    audit_.reset();
    return ReadFile(folder_.PathOf("audit.log"), 1 << 20).value_or("");
  }

  const identity::Profiles profiles_{folder_.PathOf("config")};
  std::unique_ptr<AuditLog> audit_ = *AuditLog::Open({.path = folder_.PathOf("audit.log")});
  const std::unique_ptr<Authoriser> authoriser_ = MakeAuthoriser();
  std::unique_ptr<Callers> callers_;
  std::unique_ptr<server::CallGate> gate_;
  std::unique_ptr<grpc::Service> service_;
  std::unique_ptr<grpc::Server> server_;
  std::string address_;
};

TEST_F(TlsTest, KnowsPeopleByTokenAndWorkersByCertificate) {
  LogIn("ann");
  EXPECT_EQ(*NameWith(*profiles_.SecurityOf("ann")), "ann");
  const auto enrolled = identity::Enroll(profiles_, "node", address_, Code(v1::HOLDER_KIND_WORKER, "node-1"));
  ASSERT_TRUE(enrolled.ok()) << enrolled.status();
  EXPECT_EQ(*NameWith(*profiles_.SecurityOf("node")), "node-1");
  ASSERT_TRUE(identity::RenewCertificate(profiles_, "node").ok());
  EXPECT_EQ(*NameWith(*profiles_.SecurityOf("node")), "node-1");
  ASSERT_TRUE(Revoke("node-1").ok());
  EXPECT_EQ(NameWith(*profiles_.SecurityOf("node")).status().code(), absl::StatusCode::kUnauthenticated);
}

TEST_F(TlsTest, RefusesWhoHasNeither) {
  const std::string token = LogIn("ann");
  rpc::Security security = *profiles_.SecurityOf("ann");
  security.token = "";
  EXPECT_EQ(NameWith(security).status().code(), absl::StatusCode::kUnauthenticated);
  const std::shared_ptr<grpc::Channel> channel = rpc::MakeChannel(address_, security);
  for (const std::string& value :
       {token, "Basic " + token, "Bearer " + token + "x", std::string("Bearer ")}) {
    grpc::ClientContext context;
    context.AddMetadata("authorization", value);
    EXPECT_EQ(NameOver(channel, context).status().code(), absl::StatusCode::kUnauthenticated);
  }
}

TEST_F(TlsTest, OneCallHasOneIdentity) {
  const std::string ann = LogIn("ann");
  const std::string bob = LogIn("bob");
  rpc::Security security = *profiles_.SecurityOf("ann");
  security.token = "";
  // Over one connection: what is known of a call must not stick to it.
  const std::shared_ptr<grpc::Channel> channel = rpc::MakeChannel(address_, security);
  for (const auto& [token, name] : {std::pair(ann, "ann"), std::pair(bob, "bob"), std::pair(ann, "ann")}) {
    grpc::ClientContext context;
    context.AddMetadata("authorization", "Bearer " + token);
    EXPECT_EQ(*NameOver(channel, context), name);
  }
  grpc::ClientContext two;
  two.AddMetadata("authorization", "Bearer " + ann);
  two.AddMetadata("authorization", "Bearer " + bob);
  EXPECT_EQ(NameOver(channel, two).status().code(), absl::StatusCode::kUnauthenticated);
  ASSERT_TRUE(identity::Enroll(profiles_, "node", address_, Code(v1::HOLDER_KIND_WORKER, "node-1")).ok());
  rpc::Security both = *profiles_.SecurityOf("node");
  both.token = ann;
  EXPECT_EQ(NameWith(both).status().code(), absl::StatusCode::kUnauthenticated);
}

TEST_F(TlsTest, AsksTheAuthoriser) {
  LogIn("ann");
  v1::AccessService::Stub stub(rpc::MakeChannel(address_, *profiles_.SecurityOf("ann")));
  grpc::ClientContext context;
  v1::ListIdentitiesResponse response;
  EXPECT_EQ(stub.ListIdentities(&context, {}, &response).error_code(), grpc::StatusCode::PERMISSION_DENIED);
}

TEST_F(TlsTest, GuessesOfCodesAreBoundedAndAudited) {
  LogIn("ann");
  rpc::Security security = *profiles_.SecurityOf("ann");
  security.token = "";
  v1::AccessService::Stub stub(rpc::MakeChannel(address_, security));
  int guesses = 0;
  grpc::StatusCode code = grpc::StatusCode::OK;
  while (code != grpc::StatusCode::UNAVAILABLE && guesses < 100) {
    grpc::ClientContext context;
    v1::LoginRequest request;
    request.set_code("a-guess");
    v1::LoginResponse response;
    code = stub.Login(&context, request, &response).error_code();
    EXPECT_NE(code, grpc::StatusCode::OK);
    ++guesses;
  }
  EXPECT_EQ(guesses, 20) << "and the login that succeeded";
  const std::string text = AuditText();
  EXPECT_THAT(text, HasSubstr("role=nobody id=- address=ipv4:127.0.0.1:"));
  EXPECT_THAT(text, HasSubstr("rpc=lumifold.v1.AccessService/Login outcome=OK"));
  EXPECT_THAT(text, HasSubstr("rpc=lumifold.v1.AccessService/Login outcome=UNAVAILABLE"));
  EXPECT_THAT(text, ::testing::Not(HasSubstr("a-guess")));
}

TEST_F(TlsTest, CallsThatAreRefusedBeforeTheirMessagesAreReadAreAudited) {
  LogIn("ann");
  v1::AccessService::Stub stub(rpc::MakeChannel(address_, *profiles_.SecurityOf("ann")));
  grpc::ClientContext context;
  v1::ListIdentitiesResponse response;
  EXPECT_EQ(stub.ListIdentities(&context, {}, &response).error_code(), grpc::StatusCode::PERMISSION_DENIED);
  rpc::Security nobody = *profiles_.SecurityOf("ann");
  nobody.token = "";
  EXPECT_FALSE(NameWith(nobody).ok());
  const std::string text = AuditText();
  EXPECT_THAT(text, HasSubstr("identity=\"ann\" role=read"));
  EXPECT_THAT(text, HasSubstr("rpc=lumifold.v1.AccessService/ListIdentities outcome=PERMISSION_DENIED"));
  EXPECT_THAT(text, HasSubstr("rpc=lumifold.v1.AccessService/WhoAmI outcome=UNAUTHENTICATED"));
}

TEST_F(TlsTest, TrustsTheAuthorityOfTheCodeOnly) {
  EXPECT_EQ(identity::FetchPinnedCa(address_, std::string(32, 'x'), absl::Seconds(10)).status().code(),
            absl::StatusCode::kUnauthenticated);
  grpc::ServerBuilder builder;
  int port = 0;
  builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
  const std::unique_ptr<Callers> callers = MakeLocalCallers();
  server::CallGate gate(GateOptions(callers.get()));
  const std::unique_ptr<grpc::Service> service = server::MakeAccessService(nullptr, &gate);
  builder.RegisterService(service.get());
  const std::unique_ptr<grpc::Server> plain = builder.BuildAndStart();
  const std::string address = absl::StrCat("127.0.0.1:", port);
  EXPECT_EQ(identity::FetchPinnedCa(address, std::string(32, 'x'), absl::Seconds(10)).status().code(),
            absl::StatusCode::kUnavailable);
  EXPECT_EQ(identity::IsEncrypted(address, absl::Seconds(10)), false);
  EXPECT_EQ(identity::IsEncrypted(address_, absl::Seconds(10)), true);
  v1::AccessService::Stub stub(rpc::MakeChannel(address, {}));
  grpc::ClientContext context;
  v1::RevokeResponse response;
  const grpc::Status status = stub.Revoke(&context, {}, &response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_THAT(status.error_message(), HasSubstr("no access control"));
  plain->Shutdown();
  EXPECT_EQ(identity::IsEncrypted(address, absl::Seconds(1)), std::nullopt) << "nothing listens";
}

}  // namespace
}  // namespace lumifold::access
