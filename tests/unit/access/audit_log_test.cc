#include "server/access/audit_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <string>

#include "absl/strings/str_cat.h"
#include "filter/image/file_io.h"
#include "tests/support/temp_folder.h"

namespace lumifold::access {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class AuditLogTest : public ::testing::Test {
 protected:
  static AuditEvent Event(const std::string& subject = "j-1") {
    return {
        .caller = {.kind = IdentityKind::kPerson, .name = "ann", .scopes = {Scope::kSubmit}, .id = "00ab"},
        .address = "ipv4:192.0.2.1:50000",
        .rpc_path = "/lumifold.v1.FarmService/CancelJob",
        .subject = subject,
        .outcome = absl::OkStatus()};
  }
  std::string Content(const std::string& suffix = "") const {
    return ReadFile(Path() + suffix, 1 << 24).value_or("");
  }
  std::string Path() const { return folder_.PathOf("audit.log"); }

  TempFolder folder_;
  const absl::Time now_ = absl::FromUnixMillis(1'700'000'000'123);
};

TEST_F(AuditLogTest, SaysWhoDidWhat) {
  EXPECT_EQ(AuditLine(now_, Event()),
            "2023-11-14T22:13:20.123Z info event=call identity=\"ann\" role=submit id=00ab "
            "address=ipv4:192.0.2.1:50000 rpc=lumifold.v1.FarmService/CancelJob subject=\"j-1\" outcome=OK");
  AuditEvent traced = Event();
  traced.trace_parent = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";
  EXPECT_THAT(AuditLine(now_, traced), HasSubstr(" trace=4bf92f3577b34da6a3ce929d0e0e4736 outcome=OK"));
  AuditEvent refused = Event("");
  refused.caller = {};
  refused.address = "";
  refused.rpc_path = "/somebody\n/else";
  refused.outcome = absl::UnauthenticatedError("the token is not valid");
  EXPECT_EQ(AuditLine(now_, refused),
            "2023-11-14T22:13:20.123Z warn event=call identity=\"\" role=nobody id=- address=- rpc=unknown "
            "outcome=UNAUTHENTICATED error=\"the token is not valid\"");
}

TEST_F(AuditLogTest, TextOfCallersStaysInItsField) {
  AuditEvent event = Event("j-1\"\nforged event=call identity=\"root\"");
  event.outcome = absl::NotFoundError(std::string(100'000, 'x'));
  const std::string line = AuditLine(now_, event);
  EXPECT_THAT(line, HasSubstr("subject=\"j-1\\\" forged event=call identity=\\\"root\\\"\""));
  EXPECT_THAT(line, Not(HasSubstr("\n")));
  EXPECT_LT(line.size(), 2000u);
}

TEST_F(AuditLogTest, AppendsAndIsReadableByItsOwnerOnly) {
  for (int i = 0; i < 2; ++i) {
    const auto log = *AuditLog::Open({.path = Path()});
    log->Write(now_, Event(absl::StrCat("j-", i)));
  }
  EXPECT_EQ(Content(), AuditLine(now_, Event("j-0")) + "\n" + AuditLine(now_, Event("j-1")) + "\n");
  struct stat info = {};
  ASSERT_EQ(stat(Path().c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0600u);
}

TEST_F(AuditLogTest, IsRotatedBySize) {
  {
    const auto log = *AuditLog::Open({.path = Path(), .max_file_bytes = 1000, .kept_files = 3});
    for (int i = 0; i < 100; ++i) log->Write(now_, Event(absl::StrCat("j-", i)));
  }
  for (const char* suffix : {"", ".1", ".2", ".3"}) {
    EXPECT_LE(Content(suffix).size(), 1000u) << suffix;
    EXPECT_THAT(Content(suffix), HasSubstr("subject=\"j-")) << suffix;
  }
  EXPECT_THAT(Content(), HasSubstr("subject=\"j-99\""));
  EXPECT_FALSE(std::filesystem::exists(Path() + ".4"));
}

TEST_F(AuditLogTest, LinesOverTheLimitAreCounted) {
  constexpr int kLines = 1000;
  {
    const auto log = *AuditLog::Open({.path = Path(), .max_waiting_bytes = 500});
    for (int i = 0; i < kLines; ++i) log->Write(now_, Event());
  }
  const std::string content = Content();
  int64_t lines = 0;
  int64_t dropped = 0;
  for (size_t at = 0; at < content.size(); at = content.find('\n', at) + 1) {
    const std::string line = content.substr(at, content.find('\n', at) - at);
    const size_t count = line.find("event=audit_dropped lines=");
    if (count == std::string::npos) {
      ++lines;
    } else {
      dropped += std::stoll(line.substr(count + 26));
    }
  }
  EXPECT_EQ(lines + dropped, kLines);
}

TEST_F(AuditLogTest, AFileThatCannotBeOpenedIsNamed) {
  const absl::Status status = AuditLog::Open({.path = folder_.PathOf("missing/audit.log")}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), HasSubstr("missing/audit.log"));
}

}  // namespace
}  // namespace lumifold::access
