#include "proto/identity/profile.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>

#include "proto/identity/private_file.h"
#include "tests/support/temp_folder.h"

namespace lumifold::identity {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class ProfileTest : public ::testing::Test {
 protected:
  void Write(const std::string& name, const std::string& server,
             Profile::Kind kind = Profile::Kind::kPerson) {
    ASSERT_TRUE(profiles_.WritePendingCa(name, "authority").ok());
    ASSERT_TRUE(
        profiles_.Write(name, {.server = server, .kind = kind, .name = "ann"}, "authority", "secret\n").ok());
  }
  std::string FileOf(const std::string& name, const std::string& file) {
    return folder_.PathOf("config/" + name + "/" + file);
  }

  TempFolder folder_;
  const Profiles profiles_{folder_.PathOf("config")};
};

TEST_F(ProfileTest, GivesWhatAConnectionNeeds) {
  Write("default", "farm:7700");
  const rpc::Security person = *profiles_.SecurityOf("default");
  EXPECT_EQ(person.token, "secret");
  EXPECT_EQ(person.certificate_path, "");
  EXPECT_EQ(*ReadPrivateFile(person.ca_path, 100), "authority");
  EXPECT_FALSE(std::filesystem::exists(FileOf("default", "ca.pem.pending")));
  Write("default", "farm:7700", Profile::Kind::kWorker);
  const rpc::Security worker = *profiles_.SecurityOf("default");
  EXPECT_EQ(worker.token, "");
  EXPECT_EQ(worker.certificate_path, FileOf("default", "worker.pem"));
  EXPECT_FALSE(std::filesystem::exists(FileOf("default", "token")));
}

TEST_F(ProfileTest, OfAPersonHasATokenOrACertificate) {
  Write("default", "farm:7700");
  EXPECT_FALSE(profiles_.Read("default")->has_certificate);
  const Profile person = {
      .server = "farm:7700", .kind = Profile::Kind::kPerson, .name = "ann", .has_certificate = true};
  ASSERT_TRUE(profiles_.Write("default", person, "authority", "key and certificate").ok());
  EXPECT_TRUE(profiles_.Read("default")->has_certificate);
  const rpc::Security security = *profiles_.SecurityOf("default");
  EXPECT_EQ(security.token, "");
  EXPECT_EQ(security.certificate_path, FileOf("default", "person.pem"));
  EXPECT_FALSE(std::filesystem::exists(FileOf("default", "token")));
  ASSERT_TRUE(profiles_.WriteCertificate("default", "newer").ok());
  EXPECT_EQ(*ReadPrivateFile(FileOf("default", "person.pem"), 100), "newer");
  Write("default", "farm:7700");
  EXPECT_FALSE(profiles_.Read("default")->has_certificate);
  EXPECT_EQ(profiles_.SecurityOf("default")->token, "secret");
}

TEST_F(ProfileTest, IsChosenByNameByServerOrByDefault) {
  using Kind = Profile::Kind;
  Write("default", "farm:7700");
  Write("other", "other:7700");
  Write("worker", "farm:7700", Kind::kWorker);
  const auto choose = [this](const std::string& named, const std::string& server, Kind kind = Kind::kPerson) {
    return *profiles_.Choose(named, server, kind);
  };
  Write("a", "farm:7700");
  EXPECT_EQ(choose("", ""), "default");
  EXPECT_EQ(choose("", "farm:7700"), "default");
  EXPECT_EQ(choose("", "other:7700"), "other");
  EXPECT_EQ(choose("", "farm:7700", Kind::kWorker), "worker");
  EXPECT_EQ(choose("", "", Kind::kWorker), std::nullopt);
  EXPECT_EQ(choose("", "third:7700"), std::nullopt);
  EXPECT_EQ(choose("other", "other:7700"), "other");
  EXPECT_EQ(profiles_.Choose("other", "farm:7700", Kind::kPerson).status().code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(profiles_.Choose("none", "", Kind::kPerson).status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(profiles_.List(), ElementsAre("a", "default", "other", "worker"));
}

TEST_F(ProfileTest, AProfileOfAFarmIsFoundByEachOfItsCoordinators) {
  Write("default", "a:7700,b:7700");
  for (const char* server : {"a:7700", "b:7700", "b:7700,a:7700", "c:7700,b:7700"}) {
    EXPECT_EQ(*profiles_.Choose("", server, Profile::Kind::kPerson), "default") << server;
    EXPECT_EQ(*profiles_.Choose("default", server, Profile::Kind::kPerson), "default") << server;
  }
  for (const char* server : {"c:7700", "a:7701", "a:7700,a:7700"})
    EXPECT_EQ(*profiles_.Choose("", server, Profile::Kind::kPerson), std::nullopt) << server;
  EXPECT_EQ(profiles_.Read("default")->server, "a:7700,b:7700");
}

TEST_F(ProfileTest, IsParsedStrictly) {
  Write("default", "farm:7700");
  const std::string good = "server=farm:7700\nkind=person\nname=ann\n";
  const auto code_of = [this](const std::string& text) {
    EXPECT_TRUE(WritePrivateFile(FileOf("default", "profile"), text).ok());
    return profiles_.Read("default").status().code();
  };
  EXPECT_EQ(code_of(good), absl::StatusCode::kOk);
  for (const std::string& bad :
       {std::string(), std::string("\n"), good + "\n", good + "name=bob\n", good + "more=1\n", good + "x",
        std::string("server=farm:7700\nkind=person\n"), std::string("server=farm\nkind=person\nname=ann\n"),
        std::string("server=farm:7700\nkind=king\nname=ann\n"),
        std::string("server=a:7700,a:7700\nkind=person\nname=ann\n"),
        std::string("server=farm:7700\nkind=person\nname=\n"),
        std::string("server=farm:7700\nkind=person\nname=a b\n"),
        std::string("server=farm:7700\r\nkind=person\nname=a\n"),
        "server=farm:7700\nkind=person\nname=" + std::string(301, 'a') + "\n", std::string(5000, 'a'),
        std::string("server=farm:7700\nkind=person\nname=a\0b\n", 39)})
    EXPECT_EQ(code_of(bad), absl::StatusCode::kInvalidArgument) << bad.substr(0, 80);
}

TEST_F(ProfileTest, RefusesSecretsThatOthersCanRead) {
  Write("default", "farm:7700");
  for (const char* file : {"profile", "token", "ca.pem"}) {
    ASSERT_EQ(chmod(FileOf("default", file).c_str(), 0644), 0);
    EXPECT_EQ(profiles_.SecurityOf("default").status().code(), absl::StatusCode::kFailedPrecondition) << file;
    ASSERT_EQ(chmod(FileOf("default", file).c_str(), 0600), 0);
  }
  ASSERT_TRUE(WritePrivateFile(FileOf("default", "token"), "a b\n").ok());
  EXPECT_EQ(profiles_.SecurityOf("default").status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(ProfileTest, ANameIsAFolderBelowTheirs) {
  for (const char* name : {"", ".", "..", "a/b", "../a", ".hidden", "a b", "a\n"}) {
    EXPECT_EQ(profiles_.Read(name).status().code(), absl::StatusCode::kInvalidArgument) << name;
    EXPECT_EQ(profiles_.Remove(name).code(), absl::StatusCode::kInvalidArgument) << name;
    EXPECT_EQ(profiles_.WritePendingCa(name, "x").status().code(), absl::StatusCode::kInvalidArgument)
        << name;
  }
  EXPECT_EQ(Profiles::CheckName(std::string(65, 'a')).code(), absl::StatusCode::kInvalidArgument);
  const absl::Status nowhere = Profiles("").WritePendingCa("a", "x").status();
  EXPECT_THAT(std::string(nowhere.message()), HasSubstr("XDG_CONFIG_HOME"));
}

TEST_F(ProfileTest, IsRemovedWithItsSecrets) {
  Write("default", "farm:7700");
  EXPECT_TRUE(profiles_.Remove("default").ok());
  EXPECT_FALSE(std::filesystem::exists(FileOf("default", "")));
  EXPECT_EQ(profiles_.Remove("default").code(), absl::StatusCode::kNotFound);
}

TEST(ProfilesFolder, IsThatOfTheEnvironment) {
  setenv("HOME", "/home/ann", 1);
  setenv("XDG_CONFIG_HOME", "/config", 1);
  EXPECT_EQ(ProfilesFolder(), "/config/lumifold");
  setenv("XDG_CONFIG_HOME", "relative", 1);
  EXPECT_EQ(ProfilesFolder(), "/home/ann/.config/lumifold");
  unsetenv("HOME");
  EXPECT_EQ(ProfilesFolder(), "");
}

}  // namespace
}  // namespace lumifold::identity
