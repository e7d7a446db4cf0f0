#include "server/access/authorisation.h"

#include <gmock/gmock.h>
#include <google/protobuf/descriptor.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "filter/image/file_io.h"
#include "lumifold/v1/access.pb.h"
#include "lumifold/v1/farm.pb.h"
#include "lumifold/v1/worker.pb.h"

namespace lumifold::access {
namespace {

using ::testing::HasSubstr;

constexpr char kBegin[] = "<!-- calls and roles: begin -->\n";
constexpr char kEnd[] = "<!-- calls and roles: end -->\n";
constexpr int64_t kMaxPageBytes = 1 << 20;

/// The paths of all calls of the protocol, whatever file they are in.
std::set<std::string> PathsOfTheProtocol() {
  // Their descriptors are known once their code is linked.
  (void)v1::GetJobRequest::descriptor();
  (void)v1::Hello::descriptor();
  (void)v1::LoginRequest::descriptor();
  std::set<std::string> paths;
  for (const auto& file : std::filesystem::directory_iterator(LUMIFOLD_SOURCE "/proto/lumifold/v1")) {
    const google::protobuf::FileDescriptor* described =
        google::protobuf::DescriptorPool::generated_pool()->FindFileByName(
            absl::StrCat("lumifold/v1/", file.path().filename().string()));
    for (int i = 0; described != nullptr && i < described->service_count(); ++i) {
      const google::protobuf::ServiceDescriptor* service = described->service(i);
      for (int j = 0; j < service->method_count(); ++j)
        paths.insert(absl::StrCat("/", service->full_name(), "/", service->method(j)->name()));
    }
  }
  return paths;
}

Identity Person(const std::set<Scope>& scopes) {
  return {.kind = IdentityKind::kPerson, .name = "ann", .scopes = scopes, .id = "1"};
}

TEST(Rules, EveryCallOfTheProtocolHasARow) {
  const std::set<std::string> paths = PathsOfTheProtocol();
  ASSERT_GT(paths.size(), 30u);
  for (const std::string& path : paths) EXPECT_NE(FindRule(path), nullptr) << path << " has no row";
  for (const Rule& rule : Rules()) {
    if (absl::StartsWith(rule.rpc_path, "/grpc.")) continue;
    EXPECT_TRUE(paths.contains(std::string(rule.rpc_path))) << rule.rpc_path << " is no call";
  }
}

TEST(Rules, WhatHasNoRowIsNobodys) {
  const auto authoriser = MakeAuthoriser();
  for (const char* path :
       {"", "/", "GetJob", "/lumifold.v1.FarmService/GetJob/", "/lumifold.v1.FarmService/getjob",
        "lumifold.v1.FarmService/GetJob", "/lumifold.v1.FarmService/GetJob ",
        "//lumifold.v1.FarmService/GetJob", "/lumifold.v1.FarmService/../GetJob"}) {
    for (const Role role : kRoles) EXPECT_EQ(AccessOf(role, path), Access::kNo) << path;
    const absl::Status refused = authoriser->Check(LocalIdentity(), path);
    EXPECT_EQ(refused.code(), absl::StatusCode::kPermissionDenied) << path;
    EXPECT_EQ(refused.message(), "a caller with the role local may not make this call");
  }
}

TEST(Rules, ARoleHasWhatTheOnesBelowItHave) {
  for (const Rule& rule : Rules()) {
    const auto access = [&](Role role) { return AccessOf(role, rule.rpc_path); };
    EXPECT_LE(access(Role::kNobody), access(Role::kRead)) << rule.rpc_path;
    EXPECT_LE(access(Role::kRead), access(Role::kSubmit)) << rule.rpc_path;
    EXPECT_LE(access(Role::kSubmit), access(Role::kAdmin)) << rule.rpc_path;
    EXPECT_EQ(access(Role::kLocal), Access::kYes) << rule.rpc_path;
  }
}

TEST(Rules, NobodyChangesAnythingButWithACode) {
  std::vector<std::string> open;
  for (const Rule& rule : Rules()) {
    if (AccessOf(Role::kNobody, rule.rpc_path) != Access::kNo) open.emplace_back(rule.rpc_path);
  }
  EXPECT_THAT(open,
              testing::ElementsAre("/grpc.health.v1.Health/Check", "/grpc.health.v1.Health/Watch",
                                   "/lumifold.v1.AccessService/Enroll", "/lumifold.v1.AccessService/Login"));
}

TEST(RoleOf, IsThatOfTheHighestScope) {
  EXPECT_EQ(RoleOf(LocalIdentity()), Role::kLocal);
  EXPECT_EQ(RoleOf(Person({})), Role::kNobody);
  EXPECT_EQ(RoleOf(Person({Scope::kRead})), Role::kRead);
  EXPECT_EQ(RoleOf(Person({Scope::kRead, Scope::kSubmit})), Role::kSubmit);
  EXPECT_EQ(RoleOf(Person({Scope::kAdmin})), Role::kAdmin);
  // Scopes do not make a worker a person.
  Identity worker = Person({Scope::kAdmin});
  worker.kind = IdentityKind::kWorker;
  EXPECT_EQ(RoleOf(worker), Role::kWorker);
}

TEST(Authoriser, NamesTheCallThatItRefuses) {
  const auto authoriser = MakeAuthoriser();
  EXPECT_TRUE(authoriser->Check(Person({Scope::kSubmit}), "/lumifold.v1.FarmService/SubmitJob").ok());
  const absl::Status refused =
      authoriser->Check(Person({Scope::kRead}), "/lumifold.v1.FarmService/SubmitJob");
  EXPECT_EQ(refused.code(), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(refused.message(), "a caller with the role read may not make lumifold.v1.FarmService/SubmitJob");
}

absl::string_view TextOf(Access access) {
  switch (access) {
    case Access::kNo:
      return "-";
    case Access::kOwn:
      return "own jobs";
    case Access::kYes:
      return "yes";
  }
  return "-";
}

std::string RulesAsMarkdown() {
  std::string text = "| call |";
  for (const Role role : kRoles) absl::StrAppend(&text, " ", NameOf(role), " |");
  absl::StrAppend(&text, "\n|---|");
  for (size_t i = 0; i < kRoles.size(); ++i) absl::StrAppend(&text, "---|");
  for (const Rule& rule : Rules()) {
    absl::string_view call = rule.rpc_path.substr(1);
    absl::ConsumePrefix(&call, "lumifold.v1.");
    absl::StrAppend(&text, "\n| ", call, " |");
    for (const Access access : rule.access) absl::StrAppend(&text, " ", TextOf(access), " |");
  }
  absl::StrAppend(&text, "\n");
  return text;
}

// LUMIFOLD_UPDATE=1 writes the table into the page.
TEST(Rules, AreTheTableOfTheSecurityPage) {
  const std::string path = LUMIFOLD_SOURCE "/docs/security.md";
  std::string page = *ReadFile(path, kMaxPageBytes);
  const size_t begin = page.find(kBegin);
  const size_t end = page.find(kEnd);
  ASSERT_LT(begin, end) << path << " has no place for the table";
  const size_t table = begin + sizeof kBegin - 1;
  if (std::getenv("LUMIFOLD_UPDATE") != nullptr) {
    page.replace(table, end - table, RulesAsMarkdown());
    ASSERT_TRUE(WriteFileAtomically(path, page).ok());
    return;
  }
  EXPECT_EQ(page.substr(table, end - table), RulesAsMarkdown())
      << "update it: LUMIFOLD_UPDATE=1 access_test --gtest_filter=Rules.*";
}

}  // namespace
}  // namespace lumifold::access
