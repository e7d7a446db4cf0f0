// The store in PostgreSQL, as several coordinators share it.
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "server/access/access_store.h"
#include "tests/support/private_postgres.h"

namespace lumifold::access {
namespace {

class PostgresAccessTest : public ::testing::Test {
 protected:
  void SetUp() override {
    static std::string why_not;
    static const std::unique_ptr<PrivatePostgres> server = PrivatePostgres::Start(&why_not);
    if (server == nullptr && why_not.find("not installed") != std::string::npos) GTEST_SKIP() << why_not;
    ASSERT_NE(server, nullptr) << why_not;
    uri_ = server->uri();
  }
  std::unique_ptr<AccessStore> Open() const {
    absl::StatusOr<std::unique_ptr<AccessStore>> store = AccessStore::Open(uri_, "");
    EXPECT_TRUE(store.ok()) << store.status();
    return store.ok() ? *std::move(store) : nullptr;
  }
  NewCredential Made(CredentialForm form, const std::string& id) const {
    NewCredential made;
    made.credential.id = id;
    made.credential.form = form;
    made.credential.name = "ann";
    made.credential.scopes = {Scope::kRead, Scope::kAdmin};
    made.credential.token_lifetime = absl::Hours(1);
    made.credential.created = now_;
    made.credential.expires = now_ + absl::Hours(1);
    made.sha256 = "hash of " + id;
    return made;
  }

  const absl::Time now_ = absl::FromUnixSeconds(1'900'000'000);
  std::string uri_;
};

TEST_F(PostgresAccessTest, TwoCoordinatorsMayStartAtOnce) {
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) threads.emplace_back([this] { EXPECT_NE(Open(), nullptr); });
  for (std::thread& thread : threads) thread.join();
}

TEST_F(PostgresAccessTest, AnInviteIsExchangedOnceWhoeverIsAsked) {
  const std::unique_ptr<AccessStore> one = Open();
  const std::unique_ptr<AccessStore> other = Open();
  ASSERT_TRUE(one->Add(Made(CredentialForm::kInvite, "invite")).ok());
  const int64_t before = *other->Version();
  const auto make = [this](const Credential& invite) -> absl::StatusOr<NewCredential> {
    EXPECT_EQ(invite.scopes, (std::set<Scope>{Scope::kRead, Scope::kAdmin}));
    EXPECT_EQ(invite.token_lifetime, absl::Hours(1));
    return Made(CredentialForm::kToken, "token");
  };
  EXPECT_TRUE(other->Exchange("hash of invite", IdentityKind::kPerson, now_, make).ok());
  EXPECT_EQ(one->Exchange("hash of invite", IdentityKind::kPerson, now_, make).code(),
            absl::StatusCode::kUnauthenticated);
  EXPECT_GT(*one->Version(), before);
  const std::vector<NewCredential> known = *one->Identities(now_);
  ASSERT_EQ(known.size(), 1u);
  EXPECT_EQ(known[0].sha256, "hash of token");
  EXPECT_EQ(known[0].credential.expires, now_ + absl::Hours(1));
  EXPECT_TRUE(one->AddFor("token", Made(CredentialForm::kCertificate, "certificate")).ok());
  EXPECT_EQ(*other->Revoke("", "ann", now_), 2);
  EXPECT_EQ(one->AddFor("token", Made(CredentialForm::kCertificate, "late")).code(),
            absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(one->List(0, 10, /*valid_only=*/true, now_)->size(), 0u);
  const std::vector<AccessStore::Numbered> all = *one->List(0, 2, /*valid_only=*/false, now_);
  ASSERT_EQ(all.size(), 2u);
  EXPECT_EQ(all[0].second.id, "certificate");
  EXPECT_EQ(all[1].second.end, Credential::End::kRevoked);
  EXPECT_EQ(one->List(all[1].first, 2, /*valid_only=*/false, now_)->front().second.id, "invite");
  EXPECT_EQ(one->Revoke("", "nobody", now_).status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace lumifold::access
