#pragma once

#include <istream>
#include <ostream>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "lumifold/v1/access.pb.h"
#include "proto/identity/profile.h"

namespace lumifold::identity {

/// A code as the user gave it: `argument`, or, where that is empty or "-", a line of `in`, so that the code
/// need not be in the list of processes. The prompt goes to `err`; null: none.
/// Errors: kInvalidArgument for what is no code. The text is not shown.
absl::StatusOr<std::string> ReadCode(const std::string& argument, std::istream* in, std::ostream* err);

/// What a person gets for a code.
enum class LoginForm { kToken, kCertificate };

/// Exchanges a person's code for a token, or for a certificate of a key that stays on this machine, and
/// writes the profile. The authority is fetched first and compared with the code; the code itself is sent
/// over a connection that this authority vouches for. `address` may be a list, see rpc::ParseEndpoints: it is
/// the profile's, and the first coordinator that can be reached is asked.
/// Errors: those of FetchPinnedCa and of AccessService; those of files as kInternal.
absl::StatusOr<v1::LoginResponse> Login(const Profiles& profiles, const std::string& profile,
                                        const std::string& address, std::string_view code,
                                        LoginForm form = LoginForm::kToken);

/// The same for a worker: makes a key, which stays on this machine, and fetches a certificate for it.
absl::StatusOr<v1::CertificateResponse> Enroll(const Profiles& profiles, const std::string& profile,
                                               const std::string& address, std::string_view code);

/// Makes a new key and fetches a certificate for it from the first of the profile's coordinators that can be
/// reached.
absl::StatusOr<v1::CertificateResponse> RenewCertificate(const Profiles& profiles,
                                                         const std::string& profile);

/// The same for a profile whose certificate is due for renewal; no effect on others.
/// Errors: also kUnauthenticated where the certificate has expired.
absl::Status RenewIfDue(const Profiles& profiles, const std::string& profile, absl::Time now);

}  // namespace lumifold::identity
