#pragma once

#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include <memory>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "absl/time/time.h"
#include "lumifold/v1/access.pb.h"
#include "proto/identity/certificate.h"
#include "proto/identity/secrets.h"
#include "server/access/access_control.h"
#include "tests/support/temp_folder.h"

namespace lumifold::access {

/// Access control in a folder of its own, with a clock that only the test moves, and its log.
class AccessFixture : public ::testing::Test {
 protected:
  AccessFixture() {
    EXPECT_TRUE(MakeAccessFolder(Options(), {"farm.example.org"}).ok());
    Open();
  }

  AccessOptions Options() {
    return {.folder = folder_.PathOf("data/access"),
            .store = store_,
            .certificate_lifetime = absl::Hours(24 * 90),
            .wall_now = [this] { return now_; },
            .log = log_};
  }
  void Open() {
    absl::StatusOr<std::unique_ptr<AccessControl>> access = AccessControl::Open(Options());
    ASSERT_TRUE(access.ok()) << access.status();
    access_ = *std::move(access);
  }

  static std::string Request() { return *identity::MakeCertificateRequest(*identity::MakePrivateKey()); }
  /// The secret part of a new code.
  std::string Invite(v1::HolderKind kind, const std::string& name,
                     const std::vector<v1::AccessScope>& scopes = {}, int64_t token_seconds = 0) {
    v1::CreateInviteRequest request;
    request.set_kind(kind);
    request.set_name(name);
    for (const v1::AccessScope scope : scopes) request.add_scopes(scope);
    request.set_token_lifetime_seconds(token_seconds);
    const absl::StatusOr<v1::CreateInviteResponse> response = access_->CreateInvite(LocalIdentity(), request);
    EXPECT_TRUE(response.ok()) << response.status();
    return identity::SecretText(identity::ParseCode(response->code())->secret);
  }
  /// With a certificate request: for a certificate.
  absl::StatusOr<v1::LoginResponse> Login(const std::string& code, const std::string& pem = "") {
    v1::LoginRequest request;
    request.set_code(code);
    request.set_certificate_request_pem(pem);
    return access_->Login(request);
  }
  absl::StatusOr<v1::CertificateResponse> Enroll(const std::string& code,
                                                 const std::string& pem = Request()) {
    v1::EnrollRequest request;
    request.set_code(code);
    request.set_certificate_request_pem(pem);
    return access_->Enroll(request);
  }
  absl::StatusOr<v1::RevokeResponse> Revoke(const std::string& name) {
    v1::RevokeRequest request;
    request.set_name(name);
    return access_->Revoke(LocalIdentity(), request);
  }
  std::string log_text() const { return log_stream_.str(); }

  TempFolder folder_;
  std::string store_;
  absl::Time now_ = absl::FromUnixSeconds(1'900'000'000);
  std::ostringstream log_stream_;
  std::shared_ptr<spdlog::logger> log_ =
      std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::ostream_sink_mt>(log_stream_));
  std::unique_ptr<AccessControl> access_;
};

}  // namespace lumifold::access
