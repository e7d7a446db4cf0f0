#include "server/access/access_control.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "proto/identity/private_file.h"
#include "server/access/certificate_authority.h"
#include "tests/unit/access/access_fixture.h"

namespace lumifold::access {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

using AccessControlTest = AccessFixture;

TEST_F(AccessControlTest, OnlyTheUserCanReadItsFiles) {
  Invite(v1::HOLDER_KIND_WORKER, "node-1");  // so that the store has its log too
  const std::string folder = Options().folder;
  struct stat info = {};
  ASSERT_EQ(stat(folder.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0700u);
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    ASSERT_EQ(stat(entry.path().c_str(), &info), 0);
    EXPECT_EQ(info.st_mode & 0777, 0600u) << entry.path();
    names.insert(entry.path().filename());
  }
  EXPECT_THAT(names, ::testing::IsSupersetOf({"access.db", "ca.key", "ca.pem", "names", "server.pem"}));
}

TEST_F(AccessControlTest, IsNotMadeTwice) {
  const absl::Status status = MakeAccessFolder(Options(), {});
  EXPECT_EQ(status.code(), absl::StatusCode::kAlreadyExists);
  EXPECT_THAT(std::string(status.message()), HasSubstr("has been set up before"));
}

TEST_F(AccessControlTest, KnowsTheNamesOfItsCertificate) {
  EXPECT_THAT(access_->Hosts(), ElementsAre("localhost", "127.0.0.1", "::1", "farm.example.org"));
  AccessOptions options = Options();
  options.folder = folder_.PathOf("unnamed");
  ASSERT_TRUE(MakeAccessFolder(options, {"localhost"}).ok());
  EXPECT_THAT((*AccessControl::Open(options))->Hosts(), ElementsAre("localhost", "127.0.0.1", "::1"));
}

TEST_F(AccessControlTest, RefusesAHostThatIsNone) {
  AccessOptions options = Options();
  options.folder = folder_.PathOf("other");
  for (const char* host : {"a b", "a,DNS:b", "-a", "", "a..b", "*.a"})
    EXPECT_EQ(MakeAccessFolder(options, {host}).code(), absl::StatusCode::kInvalidArgument) << host;
  EXPECT_FALSE(HasAccessFolder(options.folder));
}

TEST_F(AccessControlTest, ACodeGivesOneToken) {
  const std::string code =
      Invite(v1::HOLDER_KIND_PERSON, "ann", {v1::ACCESS_SCOPE_READ, v1::ACCESS_SCOPE_SUBMIT});
  const absl::StatusOr<v1::LoginResponse> login = Login(code);
  ASSERT_TRUE(login.ok()) << login.status();
  const absl::StatusOr<Credential> known = access_->known().OfToken(login->token(), now_);
  ASSERT_TRUE(known.ok()) << known.status();
  EXPECT_EQ(known->identity(), (Identity{.kind = IdentityKind::kPerson,
                                         .name = "ann",
                                         .scopes = {Scope::kRead, Scope::kSubmit},
                                         .id = known->id}));
  EXPECT_EQ(Login(code).status().code(), absl::StatusCode::kUnauthenticated);
}

TEST_F(AccessControlTest, OneAnswerForEveryCodeThatIsNotValid) {
  const std::string used = Invite(v1::HOLDER_KIND_PERSON, "ann", {v1::ACCESS_SCOPE_READ});
  ASSERT_TRUE(Login(used).ok());
  const std::string worker = Invite(v1::HOLDER_KIND_WORKER, "node-1");
  const std::string revoked = Invite(v1::HOLDER_KIND_PERSON, "bob", {v1::ACCESS_SCOPE_READ});
  ASSERT_TRUE(Revoke("bob").ok());
  const std::string expired = Invite(v1::HOLDER_KIND_PERSON, "eve", {v1::ACCESS_SCOPE_READ});
  std::set<std::string> messages;
  for (const std::string& code : {used, worker, revoked, std::string("guess")}) {
    const absl::Status status = Login(code).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kUnauthenticated);
    messages.insert(std::string(status.message()));
  }
  now_ += kInviteLifetime;
  messages.insert(std::string(Login(expired).status().message()));
  EXPECT_EQ(messages.size(), 1u);
  EXPECT_EQ(Login("").status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(Login(std::string(257, 'a')).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(AccessControlTest, ATokenExpires) {
  const absl::StatusOr<v1::LoginResponse> login =
      Login(Invite(v1::HOLDER_KIND_PERSON, "ann", {v1::ACCESS_SCOPE_READ}, 60));
  ASSERT_TRUE(login.ok());
  EXPECT_EQ(login->expires_unix_ms(), absl::ToUnixMillis(now_ + absl::Seconds(60)));
  EXPECT_TRUE(access_->known().OfToken(login->token(), now_ + absl::Seconds(59)).ok());
  EXPECT_EQ(access_->known().OfToken(login->token(), now_ + absl::Seconds(60)).status().code(),
            absl::StatusCode::kUnauthenticated);
}

TEST_F(AccessControlTest, WhoComesWithAnExpiredTokenIsToldSoForAWeek) {
  const absl::StatusOr<v1::LoginResponse> login =
      Login(Invite(v1::HOLDER_KIND_PERSON, "ann", {v1::ACCESS_SCOPE_READ}, 60));
  ASSERT_TRUE(login.ok());
  const auto told_after = [&](absl::Duration time) {
    now_ += time;
    Invite(v1::HOLDER_KIND_PERSON, "bob", {v1::ACCESS_SCOPE_READ});  // changes the store, which is read again
    access_->Refresh();
    const absl::Status status = access_->known().OfToken(login->token(), now_).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kUnauthenticated);
    return std::string(status.message());
  };
  EXPECT_EQ(told_after(absl::Seconds(60)), "the token of ann has expired");
  EXPECT_EQ(told_after(absl::Hours(24 * 7)), "the token is not valid");
}

TEST_F(AccessControlTest, KnowsWhoIsAdmittedFromItsStartOn) {
  const absl::StatusOr<v1::LoginResponse> login =
      Login(Invite(v1::HOLDER_KIND_PERSON, "ann", {v1::ACCESS_SCOPE_READ}));
  ASSERT_TRUE(login.ok());
  const absl::StatusOr<std::unique_ptr<AccessControl>> next = AccessControl::Open(Options());
  ASSERT_TRUE(next.ok());
  EXPECT_TRUE((*next)->known().OfToken(login->token(), now_).ok());
}

TEST_F(AccessControlTest, ARevocationCountsOnOtherCoordinatorsToo) {
  absl::StatusOr<std::unique_ptr<AccessControl>> other = AccessControl::Open(Options());
  ASSERT_TRUE(other.ok());
  const absl::StatusOr<v1::LoginResponse> login =
      Login(Invite(v1::HOLDER_KIND_PERSON, "ann", {v1::ACCESS_SCOPE_READ}));
  ASSERT_TRUE(login.ok());
  (*other)->Refresh();
  const absl::StatusOr<Credential> there = (*other)->known().OfToken(login->token(), now_);
  ASSERT_TRUE(there.ok()) << there.status();
  std::string why;
  (*other)->open_calls().Add(there->identity(),
                             [&why](const absl::Status& status) { why = std::string(status.message()); });
  ASSERT_EQ(Revoke("ann")->revoked(), 1);
  (*other)->Refresh();
  EXPECT_EQ(why, "the token of ann was revoked");
  EXPECT_FALSE((*other)->known().OfToken(login->token(), now_).ok());
  EXPECT_EQ(Revoke("ann")->revoked(), 0);
  EXPECT_EQ(Revoke("nobody").status().code(), absl::StatusCode::kNotFound);
}

/// The serial number that a certificate names.
std::string SerialOf(const std::string& certificate_pem) {
  const identity::CertificateFacts facts = *identity::ReadCertificate(certificate_pem);
  return facts.uris.at(1).substr(std::string(kSerialUri).size());
}

TEST_F(AccessControlTest, APersonGetsACertificateInsteadOfATokenAndRenewsIt) {
  const std::string code = Invite(v1::HOLDER_KIND_PERSON, "ann", {v1::ACCESS_SCOPE_SUBMIT});
  EXPECT_EQ(Login(code, "no request").status().code(), absl::StatusCode::kInvalidArgument);
  const absl::StatusOr<v1::LoginResponse> login = Login(code, Request());
  ASSERT_TRUE(login.ok()) << login.status();
  EXPECT_EQ(login->token(), "");
  EXPECT_FALSE(Login(code, Request()).ok()) << "the code is used up";
  const identity::CertificateFacts facts = *identity::ReadCertificate(login->certificate_pem());
  EXPECT_EQ(facts.uris.at(0), "lumifold:person:ann");
  const Credential known = *access_->known().OfCertificate(SerialOf(login->certificate_pem()), now_);
  EXPECT_EQ(known.kind, IdentityKind::kPerson);
  EXPECT_EQ(known.scopes, std::set<Scope>{Scope::kSubmit});
  EXPECT_EQ(DescribeCaller(access_.get(), known.identity()).expires_unix_ms(), login->expires_unix_ms());
  v1::RenewCertificateRequest request;
  request.set_certificate_request_pem(Request());
  for (int i = 0; i < 4; ++i) {  // for more than a year
    now_ += absl::Hours(24 * 60);
    const absl::StatusOr<v1::CertificateResponse> next = access_->RenewCertificate(known.identity(), request);
    EXPECT_EQ(next.ok(), i == 0) << "a certificate that has expired renews nothing";
    if (next.ok()) {
      const Credential renewed = *access_->known().OfCertificate(SerialOf(next->certificate_pem()), now_);
      EXPECT_EQ(renewed.scopes, known.scopes);
      EXPECT_EQ(renewed.kind, known.kind);
    }
  }
  EXPECT_EQ(Revoke("ann")->revoked(), 0) << "both have expired";
}

TEST_F(AccessControlTest, CertificatesEndWithTheTimeThatAPersonWasInvitedFor) {
  const std::string code = Invite(v1::HOLDER_KIND_PERSON, "ann", {v1::ACCESS_SCOPE_READ}, 100 * 24 * 3600);
  const absl::Time end = now_ + absl::Hours(24 * 100);
  const absl::StatusOr<v1::LoginResponse> login = Login(code, Request());
  ASSERT_TRUE(login.ok()) << login.status();
  EXPECT_EQ(absl::FromUnixMillis(login->expires_unix_ms()), now_ + absl::Hours(24 * 90));
  v1::RenewCertificateRequest request;
  request.set_certificate_request_pem(Request());
  now_ += absl::Hours(24 * 60);
  const absl::StatusOr<v1::CertificateResponse> last = access_->RenewCertificate(
      access_->known().OfCertificate(SerialOf(login->certificate_pem()), now_)->identity(), request);
  ASSERT_TRUE(last.ok()) << last.status();
  EXPECT_EQ(absl::FromUnixMillis(last->expires_unix_ms()), end);
  now_ += absl::Hours(24 * 30);
  EXPECT_EQ(
      access_
          ->RenewCertificate(
              access_->known().OfCertificate(SerialOf(last->certificate_pem()), now_)->identity(), request)
          .status()
          .code(),
      absl::StatusCode::kFailedPrecondition);
}

TEST_F(AccessControlTest, AWorkerGetsACertificateAndRenewsIt) {
  const absl::StatusOr<v1::CertificateResponse> first = Enroll(Invite(v1::HOLDER_KIND_WORKER, "node-1"));
  ASSERT_TRUE(first.ok()) << first.status();
  const identity::CertificateFacts facts = *identity::ReadCertificate(first->certificate_pem());
  EXPECT_EQ(facts.common_name, "node-1");
  ASSERT_EQ(facts.uris.size(), 2u);
  EXPECT_EQ(facts.uris[0], "lumifold:worker:node-1");
  const std::string serial = facts.uris[1].substr(std::string(kSerialUri).size());
  const absl::StatusOr<Credential> known = access_->known().OfCertificate(serial, now_);
  ASSERT_TRUE(known.ok()) << known.status();
  EXPECT_TRUE(known->scopes.empty());
  v1::RenewCertificateRequest request;
  request.set_certificate_request_pem(Request());
  now_ += absl::Hours(24 * 60);
  const absl::StatusOr<v1::CertificateResponse> second =
      access_->RenewCertificate(known->identity(), request);
  ASSERT_TRUE(second.ok()) << second.status();
  EXPECT_EQ(second->name(), "node-1");
  EXPECT_GT(second->expires_unix_ms(), first->expires_unix_ms());
  EXPECT_TRUE(access_->known().OfCertificate(serial, now_).ok());
  // What has expired has a successor: its owner connects again.
  now_ += absl::Hours(24 * 31);
  EXPECT_EQ(access_->known().Check(known->identity(), now_).code(), absl::StatusCode::kUnavailable);
}

TEST_F(AccessControlTest, ARevokedWorkerCannotRenew) {
  const absl::StatusOr<v1::CertificateResponse> response = Enroll(Invite(v1::HOLDER_KIND_WORKER, "node-1"));
  const std::string serial = identity::ReadCertificate(response->certificate_pem())->uris[1].substr(16);
  const Identity worker = access_->known().OfCertificate(serial, now_)->identity();
  ASSERT_TRUE(Revoke("node-1").ok());
  v1::RenewCertificateRequest request;
  request.set_certificate_request_pem(Request());
  EXPECT_EQ(access_->RenewCertificate(worker, request).status().code(), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(access_->RenewCertificate(LocalIdentity(), request).status().code(),
            absl::StatusCode::kFailedPrecondition);
}

TEST_F(AccessControlTest, ABadRequestDoesNotUseUpTheCode) {
  const std::string code = Invite(v1::HOLDER_KIND_WORKER, "node-1");
  for (const std::string& pem :
       {std::string(), std::string("-----BEGIN CERTIFICATE REQUEST-----\n"), *identity::MakePrivateKey(),
        std::string(identity::kMaxRequestBytes + 1, 'a')})
    EXPECT_EQ(Enroll(code, pem).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(Enroll(code).ok());
}

TEST_F(AccessControlTest, ChecksTheFieldsOfAnInvite) {
  const auto code_of = [this](auto change) {
    v1::CreateInviteRequest request;
    request.set_kind(v1::HOLDER_KIND_PERSON);
    request.set_name("ann");
    request.add_scopes(v1::ACCESS_SCOPE_READ);
    change(&request);
    return access_->CreateInvite(LocalIdentity(), request).status().code();
  };
  using Request = v1::CreateInviteRequest;
  constexpr auto kBad = absl::StatusCode::kInvalidArgument;
  EXPECT_EQ(code_of([](Request*) {}), absl::StatusCode::kOk);
  EXPECT_EQ(code_of([](Request* r) { r->set_kind(v1::HOLDER_KIND_LOCAL); }), kBad);
  EXPECT_EQ(code_of([](Request* r) { r->clear_scopes(); }), kBad);
  EXPECT_EQ(code_of([](Request* r) { r->set_scopes(0, static_cast<v1::AccessScope>(9)); }), kBad);
  EXPECT_EQ(code_of([](Request* r) { r->set_token_lifetime_seconds(-1); }), kBad);
  EXPECT_EQ(code_of([](Request* r) { r->set_token_lifetime_seconds(31'536'001); }), kBad);
  EXPECT_EQ(code_of([](Request* r) { r->set_kind(v1::HOLDER_KIND_WORKER); }), kBad);  // with a scope
  for (const char* name : {"", "-a", "a b", "a,URI:lumifold:worker:b", "a\n", "\xc3\xa4"})
    EXPECT_EQ(code_of([name](Request* r) { r->set_name(name); }), kBad) << name;
  EXPECT_EQ(code_of([](Request* r) { r->set_name(std::string(65, 'a')); }), kBad);
}

TEST_F(AccessControlTest, ListsInPages) {
  for (const char* name : {"a", "b", "c"}) Invite(v1::HOLDER_KIND_WORKER, name);
  ASSERT_TRUE(Revoke("b").ok());
  v1::ListIdentitiesRequest request;
  request.set_limit(2);
  const absl::StatusOr<v1::ListIdentitiesResponse> first = access_->ListIdentities(request);
  ASSERT_TRUE(first.ok());
  request.set_page_token(first->next_page_token());
  const absl::StatusOr<v1::ListIdentitiesResponse> second = access_->ListIdentities(request);
  std::vector<std::string> names;
  for (const auto* page : {&*first, &*second}) {
    for (const v1::Credential& credential : page->credentials()) names.push_back(credential.name());
  }
  EXPECT_THAT(names, ElementsAre("c", "b", "a"));
  EXPECT_EQ(first->credentials(1).state(), v1::CREDENTIAL_STATE_REVOKED);
  EXPECT_TRUE(second->next_page_token().empty());
  request.set_valid_only(true);
  request.clear_page_token();
  EXPECT_EQ(access_->ListIdentities(request)->credentials_size(), 2);
  for (const char* token : {"x", "-1", "0"}) {
    request.set_page_token(token);
    EXPECT_EQ(access_->ListIdentities(request).status().code(), absl::StatusCode::kInvalidArgument) << token;
  }
}

TEST_F(AccessControlTest, RenewsTheServersCertificate) {
  const std::string path = access_->security().certificate_path;
  const auto facts = [&path] { return *identity::ReadCertificate(*identity::ReadPrivateFile(path, 65536)); };
  const identity::CertificateFacts first = facts();
  EXPECT_THAT(first.hosts, ElementsAre("localhost", "127.0.0.1", "::1", "farm.example.org"));
  now_ += absl::Hours(24 * 59);
  access_->Refresh();
  EXPECT_EQ(facts().sha256, first.sha256);
  now_ += absl::Hours(24 * 2);
  access_->Refresh();
  EXPECT_EQ(facts().not_after, now_ + absl::Hours(24 * 90));
  ASSERT_TRUE(identity::WritePrivateFile(Options().folder + "/names", "10.0.0.7\n").ok());
  access_->Refresh();
  EXPECT_THAT(facts().hosts, ElementsAre("localhost", "127.0.0.1", "::1", "10.0.0.7"));
}

TEST_F(AccessControlTest, NoSecretInLogsOrInTheStore) {
  const std::string person = Invite(v1::HOLDER_KIND_PERSON, "ann", {v1::ACCESS_SCOPE_ADMIN});
  const std::string worker = Invite(v1::HOLDER_KIND_WORKER, "node-1");
  const std::string token = Login(person)->token();
  ASSERT_TRUE(Enroll(worker).ok());
  Login(person).IgnoreError();
  access_.reset();
  std::string stored;
  for (const auto& entry : std::filesystem::directory_iterator(Options().folder))
    if (absl::StrContains(entry.path().string(), "access.db"))
      stored += *identity::ReadPrivateFile(entry.path(), 1 << 20);
  EXPECT_THAT(stored, HasSubstr("node-1"));
  for (const std::string& secret : {person, worker, token}) {
    EXPECT_THAT(log_text(), Not(HasSubstr(secret)));
    EXPECT_THAT(stored, Not(HasSubstr(secret)));
  }
  EXPECT_THAT(log_text(), HasSubstr("event=worker_enrolled name=node-1"));
}

TEST(CertifiedHosts, OneOfThemIsForOtherMachines) {
  EXPECT_EQ(HostForOthers({}, "farm7"), "farm7") << "without a certificate";
  EXPECT_EQ(HostForOthers(HostsOfServer({"farm.example", "farm7"}), "farm7"), "farm7");
  EXPECT_EQ(HostForOthers(HostsOfServer({"farm.example", "10.0.0.7"}), "farm7"), "farm.example");
  EXPECT_EQ(HostForOthers({"10.0.0.7", "localhost"}, "farm7"), "10.0.0.7") << "in any order";
  EXPECT_EQ(HostForOthers(HostsOfServer({}), "farm7"), "localhost") << "there is no other";
}

}  // namespace
}  // namespace lumifold::access
