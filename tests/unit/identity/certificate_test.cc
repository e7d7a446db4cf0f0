#include "proto/identity/certificate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "absl/strings/match.h"

namespace lumifold::identity {
namespace {

TEST(Certificate, ARequestIsSignedByAKey) {
  const absl::StatusOr<std::string> key = MakePrivateKey();
  ASSERT_TRUE(key.ok());
  const absl::StatusOr<std::string> request = MakeCertificateRequest(*key);
  ASSERT_TRUE(request.ok());
  EXPECT_TRUE(absl::StartsWith(*request, "-----BEGIN CERTIFICATE REQUEST-----"));
  EXPECT_LE(request->size(), kMaxRequestBytes);
  EXPECT_NE(*key, *MakePrivateKey());
}

TEST(Certificate, WhatIsNoneIsRefused) {
  for (const std::string& pem :
       {std::string(), std::string("-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"),
        *MakePrivateKey(), std::string(100'000, '\0')}) {
    EXPECT_EQ(ReadCertificate(pem).status().code(), absl::StatusCode::kInvalidArgument);
    if (!absl::StrContains(pem, "PRIVATE")) {
      EXPECT_EQ(MakeCertificateRequest(pem).status().code(), absl::StatusCode::kInvalidArgument);
    }
  }
}

TEST(Certificate, IsDueAfterTwoThirdsOfItsLife) {
  CertificateFacts facts;
  facts.not_before = absl::FromUnixSeconds(1000);
  facts.not_after = absl::FromUnixSeconds(1300);
  EXPECT_FALSE(IsDueForRenewal(facts, absl::FromUnixSeconds(1199)));
  EXPECT_TRUE(IsDueForRenewal(facts, absl::FromUnixSeconds(1200)));
  EXPECT_TRUE(IsDueForRenewal(facts, absl::FromUnixSeconds(2000)));
}

}  // namespace
}  // namespace lumifold::identity
