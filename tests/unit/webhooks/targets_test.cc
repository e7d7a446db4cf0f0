#include "server/webhooks/targets.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lumifold::webhooks {
namespace {

using absl::StatusCode;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

StatusCode CodeOf(const AllowedHosts& hosts, const std::string& url) {
  return hosts.Check(url).status().code();
}

TEST(WebhookTargets, AHostIsAllowedWithThePortsOfItsEntry) {
  const AllowedHosts hosts = *AllowedHosts::Parse("hooks.example.org, Farm.example:8080,[::1]:9000");
  EXPECT_EQ(CodeOf(hosts, "https://hooks.example.org"), StatusCode::kOk);
  EXPECT_EQ(CodeOf(hosts, "https://HOOKS.example.org:443/jobs?id=7"), StatusCode::kOk);
  EXPECT_EQ(CodeOf(hosts, "http://hooks.example.org/a"), StatusCode::kOk);
  EXPECT_EQ(CodeOf(hosts, "https://farm.example:8080/"), StatusCode::kOk);
  EXPECT_EQ(CodeOf(hosts, "http://[::1]:9000/x"), StatusCode::kOk);
  for (const char* url :
       {"https://hooks.example.org:444/", "https://hooks.example.org:80/", "http://hooks.example.org:443/",
        "https://farm.example/", "https://evil.hooks.example.org/", "https://hooks.example.org.evil/",
        "https://hooks.example.org./", "http://[::1]/", "http://127.0.0.1:9000/", "http://0x7f.1:9000/"})
    EXPECT_EQ(CodeOf(hosts, url), StatusCode::kPermissionDenied) << url;
  EXPECT_THAT(std::string(hosts.Check("https://a.example/secret").status().message()),
              AllOf(HasSubstr("https://a.example:443"), Not(HasSubstr("secret"))));
}

TEST(WebhookTargets, WhatIsNoUrlOfAWebServerIsRefused) {
  const AllowedHosts hosts = *AllowedHosts::Parse("a.example");
  for (const char* url :
       {"a.example", "//a.example/", "ftp://a.example/", "file:///etc/passwd", "gopher://a.example/",
        "https://user@a.example/", "https://user:word@a.example/", "https://@a.example/",

        "https://a.example/x y", "https://a.example/\r\nX: 1", "https://a.example/#part",
        "https://a.example\\@b/", "https://b.example\\a.example/", "https://a_b.example/",
        "https://[fe80::1%25eth0]/", "https://a.example:x/", "https://a.example:70000/",
        "https://\xc3\xa4.example/", "https://"})
    EXPECT_EQ(CodeOf(hosts, url), StatusCode::kInvalidArgument) << url;
  EXPECT_EQ(CodeOf(hosts, "https://a.example/" + std::string(kMaxUrlBytes, 'x')),
            StatusCode::kInvalidArgument);
  EXPECT_EQ(CodeOf(hosts, std::string("https://a.example/\0x", 20)), StatusCode::kInvalidArgument);
}

TEST(WebhookTargets, WithoutHostsAllAreRefusedWithWhatToDo) {
  const AllowedHosts none = *AllowedHosts::Parse("");
  const absl::Status status = none.Check("https://a.example/").status();
  EXPECT_EQ(status.code(), StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), HasSubstr("--webhook-hosts"));
}

TEST(WebhookTargets, AListIsHostsAlone) {
  EXPECT_THAT(AllowedHosts::Parse("a.example:8080")->origins(),
              ElementsAre("https://a.example:8080", "http://a.example:8080"));
  for (const char* list : {"https://a.example", "a.example/", "a.example/x", "u@a.example", "a.example,", ",",
                           "a.example?", "a.example:0x50", "a b"})
    EXPECT_EQ(AllowedHosts::Parse(list).status().code(), StatusCode::kInvalidArgument) << list;
}

}  // namespace
}  // namespace lumifold::webhooks
