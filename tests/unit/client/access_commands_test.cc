// The commands for identities, against a farm that only has these calls.
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/commands/run_client.h"
#include "lumifold/v1/access.grpc.pb.h"
#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class AccessCommandsTest : public ::testing::Test, public v1::AccessService::Service {
 protected:
  AccessCommandsTest() {
    int port = 0;
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(static_cast<v1::AccessService::Service*>(this));
    server_ = builder.BuildAndStart();
    address_ = absl::StrCat("127.0.0.1:", port);
    test_.environment.defaults.server = address_;
  }
  ~AccessCommandsTest() override { server_->Shutdown(std::chrono::system_clock::now()); }

  int Run(const std::vector<std::string>& arguments) {
    std::vector<const char*> argv = {"lumifold"};
    for (const std::string& argument : arguments) argv.push_back(argument.c_str());
    test_.out.str("");
    test_.err.str("");
    requests_.clear();
    return RunClient(static_cast<int>(argv.size()), argv.data(), test_.environment);
  }
  std::string Out() const { return test_.out.str(); }
  std::string Err() const { return test_.err.str(); }

  TestEnvironment test_;
  std::string address_;
  std::vector<std::string> requests_;
  std::vector<v1::Credential> credentials_;  // one on a page

 private:
  grpc::Status WhoAmI(grpc::ServerContext*, const v1::WhoAmIRequest*, v1::WhoAmIResponse* response) override {
    response->set_kind(v1::HOLDER_KIND_PERSON);
    response->set_name("ann");
    response->add_scopes(v1::ACCESS_SCOPE_READ);
    response->add_scopes(v1::ACCESS_SCOPE_ADMIN);
    response->set_id("id-1");
    response->set_expires_unix_ms(1'700'000'000'123);
    return grpc::Status::OK;
  }
  grpc::Status CreateInvite(grpc::ServerContext*, const v1::CreateInviteRequest* request,
                            v1::CreateInviteResponse* response) override {
    requests_.push_back(request->ShortDebugString());
    response->set_code("the-code");
    response->set_id("id-2");
    response->set_expires_unix_ms(1'700'000'000'456);
    return grpc::Status::OK;
  }
  grpc::Status ListIdentities(grpc::ServerContext*, const v1::ListIdentitiesRequest* request,
                              v1::ListIdentitiesResponse* response) override {
    requests_.push_back(request->ShortDebugString());
    const size_t index = request->page_token().empty() ? 0 : std::stoul(request->page_token());
    if (index < credentials_.size()) *response->add_credentials() = credentials_[index];
    if (index + 1 < credentials_.size()) response->set_next_page_token(absl::StrCat(index + 1));
    return grpc::Status::OK;
  }
  grpc::Status Revoke(grpc::ServerContext*, const v1::RevokeRequest* request,
                      v1::RevokeResponse* response) override {
    requests_.push_back(request->ShortDebugString());
    response->set_revoked(3);
    return grpc::Status::OK;
  }

  std::unique_ptr<grpc::Server> server_;
};

TEST_F(AccessCommandsTest, AnInviteIsForAPersonOrAWorker) {
  ASSERT_EQ(Run({"invite", "ann"}), 0) << Err();
  EXPECT_THAT(requests_, ElementsAre("kind: HOLDER_KIND_PERSON name: \"ann\" scopes: ACCESS_SCOPE_READ "
                                     "scopes: ACCESS_SCOPE_SUBMIT"));
  EXPECT_EQ(Out(), "the-code\n");
  EXPECT_EQ(Err(), "lumifold: for ann: lumifold login " + address_ + " CODE\n");
  ASSERT_EQ(Run({"invite", "ben", "--scope", "admin,read", "--hours", "1.5", "--json"}), 0) << Err();
  EXPECT_THAT(requests_, ElementsAre("kind: HOLDER_KIND_PERSON name: \"ben\" scopes: ACCESS_SCOPE_ADMIN "
                                     "scopes: ACCESS_SCOPE_READ token_lifetime_seconds: 5400"));
  EXPECT_EQ(
      Out(),
      "{\"schema_version\":1,\"code\":\"the-code\",\"id\":\"id-2\",\"expires_unix_ms\":1700000000456}\n");
  ASSERT_EQ(Run({"invite", "node-7", "--worker"}), 0) << Err();
  EXPECT_THAT(requests_, ElementsAre("kind: HOLDER_KIND_WORKER name: \"node-7\""));
  EXPECT_EQ(Err(), "lumifold: for node-7: lumifold-worker enroll " + address_ + " CODE\n");
  ASSERT_EQ(Run({"invite", "ann", "--hours", "0.00001"}), 0) << Err();
  EXPECT_THAT(requests_[0], HasSubstr("token_lifetime_seconds: 1")) << "a second at least";
  EXPECT_EQ(Run({"invite", "node-7", "--worker", "--scope", "read"}), 2);
  EXPECT_EQ(Run({"invite", "ann", "--scope", "write"}), 2);
  EXPECT_THAT(Err(), HasSubstr("--scope: expected read, submit or admin; got 'write'"));
  EXPECT_THAT(requests_, ElementsAre());
}

TEST_F(AccessCommandsTest, WhoAmITellsTheCaller) {
  ASSERT_EQ(Run({"whoami"}), 0) << Err();
  EXPECT_THAT(Out(), HasSubstr("name: ann\nkind: person\nscopes: read, admin\nid: id-1\nexpires: 2023-11-1"));
  ASSERT_EQ(Run({"whoami", "--json"}), 0) << Err();
  EXPECT_EQ(Out(),
            "{\"schema_version\":1,\"name\":\"ann\",\"kind\":\"person\",\"scopes\":[\"read\",\"admin\"],"
            "\"id\":\"id-1\","
            "\"expires_unix_ms\":1700000000123}\n");
}

TEST_F(AccessCommandsTest, IdentitiesAreListedPageByPage) {
  v1::Credential credential;
  credential.set_id("id-1");
  credential.set_form(v1::CREDENTIAL_FORM_TOKEN);
  credential.set_kind(v1::HOLDER_KIND_PERSON);
  credential.set_name("ann");
  credential.add_scopes(v1::ACCESS_SCOPE_SUBMIT);
  credential.set_state(v1::CREDENTIAL_STATE_VALID);
  credential.set_created_unix_ms(1'600'000'000'000);
  credential.set_expires_unix_ms(1'700'000'000'000);
  credentials_.push_back(credential);
  credential.set_id("id-2");
  credential.set_form(v1::CREDENTIAL_FORM_CERTIFICATE);
  credential.set_kind(v1::HOLDER_KIND_WORKER);
  credential.set_name("node\n7");
  credential.clear_scopes();
  credential.set_state(v1::CREDENTIAL_STATE_REVOKED);
  credentials_.push_back(credential);
  ASSERT_EQ(Run({"identities"}), 0) << Err();
  EXPECT_THAT(requests_, ElementsAre("valid_only: true", "page_token: \"1\" valid_only: true"));
  EXPECT_THAT(Out(), HasSubstr("ID                               FORM        KIND   STATE"));
  EXPECT_THAT(Out(), HasSubstr("id-1                             token       person valid   2023-11-1"));
  EXPECT_THAT(Out(), HasSubstr(" submit            ann\n"));
  EXPECT_THAT(Out(), HasSubstr("id-2                             certificate worker revoked 2023-11-1"));
  ASSERT_EQ(Run({"identities", "--all", "--json"}), 0) << Err();
  EXPECT_THAT(requests_, ElementsAre("", "page_token: \"1\""));
  EXPECT_THAT(Out(), HasSubstr("{\"schema_version\":1,\"id\":\"id-1\",\"form\":\"token\",\"kind\":\"person\","
                               "\"name\":\"ann\",\"scopes\":["
                               "\"submit\"],\"state\":\"valid\",\"created_unix_ms\":1600000000000,"
                               "\"expires_unix_ms\":1700000000000}\n"));
}

TEST_F(AccessCommandsTest, ARevocationIsOfANameOrOfOne) {
  ASSERT_EQ(Run({"revoke", "ann"}), 0) << Err();
  EXPECT_THAT(requests_, ElementsAre("name: \"ann\""));
  EXPECT_EQ(Err(), "lumifold: revoked: 3\n");
  ASSERT_EQ(Run({"revoke", "--id", "id-1"}), 0) << Err();
  EXPECT_THAT(requests_, ElementsAre("id: \"id-1\""));
  EXPECT_EQ(Run({"revoke"}), 2);
  EXPECT_EQ(Run({"revoke", "ann", "--id", "id-1"}), 2);
  EXPECT_THAT(Err(), HasSubstr("expected either NAME or --id"));
}

}  // namespace
}  // namespace lumifold::client
