#include "proto/identity/join.h"

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>

#include <memory>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "lumifold/v1/access.grpc.pb.h"
#include "proto/identity/certificate.h"
#include "proto/identity/pinned_ca.h"
#include "proto/identity/secrets.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/endpoints.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/status_codec.h"

namespace lumifold::identity {
namespace {

constexpr absl::Duration kHandshakeTimeout = absl::Seconds(10);
constexpr absl::Duration kCallTimeout = absl::Seconds(10);
/// Coordinators read each second what others of their farm have changed.
constexpr absl::Duration kUntilAllKnow = absl::Milliseconds(1500);

absl::Status OfFiles(const absl::Status& status) {
  return status.ok() ? status : absl::InternalError(status.message());
}

template <typename Request, typename Response>
absl::StatusOr<Response> Call(const std::string& address, const rpc::Security& security,
                              const Request& request,
                              grpc::Status (v1::AccessService::Stub::*method)(grpc::ClientContext*,
                                                                              const Request&, Response*)) {
  const std::unique_ptr<v1::AccessService::Stub> stub =
      v1::AccessService::NewStub(rpc::MakeChannel(address, security));
  grpc::ClientContext context;
  context.set_deadline(rpc::MonotonicDeadline(kCallTimeout));
  Response response;
  const absl::Status status = rpc::StatusFromGrpc(((*stub).*method)(&context, request, &response));
  if (absl::IsUnavailable(status) || absl::IsDeadlineExceeded(status)) {
    return absl::UnavailableError(
        absl::StrCat("cannot reach the coordinator at ", address, ": ", status.message(),
                     ". Its certificate may not have this name: see --name of 'lumifold-server init'"));
  }
  if (!status.ok()) return status;
  return response;
}

/// Asks the coordinators of the list in turn until one can be reached. Errors: those of the last.
template <typename Answer>
absl::StatusOr<Answer> AskFirst(const std::string& list,
                                absl::FunctionRef<absl::StatusOr<Answer>(const std::string&)> ask) {
  const absl::StatusOr<std::vector<std::string>> addresses = rpc::ParseEndpoints(list);
  if (!addresses.ok()) return addresses.status();
  absl::StatusOr<Answer> answer;
  for (const std::string& address : *addresses) {
    answer = ask(address);
    if (!absl::IsUnavailable(answer.status())) break;
  }
  return answer;
}

/// Waits until every coordinator of the list knows a new identity, so that its first call may go to any of
/// them.
void AwaitOthers(const std::string& list) {
  const absl::StatusOr<std::vector<std::string>> addresses = rpc::ParseEndpoints(list);
  if (addresses.ok() && addresses->size() > 1) absl::SleepFor(kUntilAllKnow);
}

/// What is left of a code once the authority is known: a connection, and the secret to send over it.
struct Opened {
  std::string address;
  std::string secret;
  std::string ca_pem;
  rpc::Security security;
};
absl::StatusOr<Opened> Open(const Profiles& profiles, const std::string& profile, const std::string& list,
                            std::string_view text) {
  const absl::StatusOr<Code> code = ParseCode(text);
  if (!code.ok()) return code.status();
  std::string reached;
  absl::StatusOr<std::string> ca_pem = AskFirst<std::string>(list, [&](const std::string& address) {
    reached = address;
    return FetchPinnedCa(address, code->ca_sha256, kHandshakeTimeout);
  });
  if (!ca_pem.ok()) return ca_pem.status();
  absl::StatusOr<std::string> ca_path = profiles.WritePendingCa(profile, *ca_pem);
  if (!ca_path.ok()) return OfFiles(ca_path.status());
  return Opened{
      .address = std::move(reached),
      .secret = SecretText(code->secret),
      .ca_pem = *std::move(ca_pem),
      .security = {.insecure = false, .ca_path = *std::move(ca_path), .certificate_path = "", .token = ""}};
}

/// A new key, and a request to certify it.
struct NewKey {
  std::string pem;
  std::string request_pem;
};
absl::StatusOr<NewKey> MakeKey() {
  absl::StatusOr<std::string> key = MakePrivateKey();
  if (!key.ok()) return key.status();
  absl::StatusOr<std::string> request_pem = MakeCertificateRequest(*key);
  if (!request_pem.ok()) return request_pem.status();
  return NewKey{.pem = *std::move(key), .request_pem = *std::move(request_pem)};
}

}  // namespace

absl::StatusOr<std::string> ReadCode(const std::string& argument, std::istream* in, std::ostream* err) {
  std::string text = argument;
  if (argument.empty() || argument == "-") {
    if (err != nullptr) *err << "Code: " << std::flush;
    if (in == nullptr || !std::getline(*in, text)) return absl::InvalidArgumentError("no code was given");
  }
  text = std::string(absl::StripAsciiWhitespace(text));
  if (const absl::StatusOr<Code> code = ParseCode(text); !code.ok()) return code.status();
  return text;
}

absl::StatusOr<v1::LoginResponse> Login(const Profiles& profiles, const std::string& profile,
                                        const std::string& address, std::string_view code, LoginForm form) {
  const absl::StatusOr<Opened> opened = Open(profiles, profile, address, code);
  if (!opened.ok()) return opened.status();
  v1::LoginRequest request;
  request.set_code(opened->secret);
  NewKey key;
  if (form == LoginForm::kCertificate) {
    absl::StatusOr<NewKey> made = MakeKey();
    if (!made.ok()) return made.status();
    key = *std::move(made);
    request.set_certificate_request_pem(key.request_pem);
  }
  absl::StatusOr<v1::LoginResponse> response =
      Call(opened->address, opened->security, request, &v1::AccessService::Stub::Login);
  if (!response.ok()) return response.status();
  const bool has_certificate = form == LoginForm::kCertificate;
  if (has_certificate && response->certificate_pem().empty())
    return absl::InternalError(absl::StrCat("the coordinator at ", address, " gave no certificate"));
  const absl::Status written =
      profiles.Write(profile,
                     {.server = address,
                      .kind = Profile::Kind::kPerson,
                      .name = response->name(),
                      .has_certificate = has_certificate},
                     opened->ca_pem,
                     has_certificate ? absl::StrCat(key.pem, response->certificate_pem(), opened->ca_pem)
                                     : absl::StrCat(response->token(), "\n"));
  if (!written.ok()) return OfFiles(written);
  AwaitOthers(address);
  return response;
}

absl::StatusOr<v1::CertificateResponse> Enroll(const Profiles& profiles, const std::string& profile,
                                               const std::string& address, std::string_view code) {
  const absl::StatusOr<Opened> opened = Open(profiles, profile, address, code);
  if (!opened.ok()) return opened.status();
  const absl::StatusOr<NewKey> key = MakeKey();
  if (!key.ok()) return key.status();
  v1::EnrollRequest request;
  request.set_code(opened->secret);
  request.set_certificate_request_pem(key->request_pem);
  absl::StatusOr<v1::CertificateResponse> response =
      Call(opened->address, opened->security, request, &v1::AccessService::Stub::Enroll);
  if (!response.ok()) return response.status();
  const absl::Status written = profiles.Write(
      profile,
      {.server = address, .kind = Profile::Kind::kWorker, .name = response->name(), .has_certificate = true},
      opened->ca_pem, absl::StrCat(key->pem, response->certificate_pem(), opened->ca_pem));
  if (!written.ok()) return OfFiles(written);
  AwaitOthers(address);
  return response;
}

absl::StatusOr<v1::CertificateResponse> RenewCertificate(const Profiles& profiles,
                                                         const std::string& profile) {
  const absl::StatusOr<Profile> read = profiles.Read(profile);
  if (!read.ok()) return OfFiles(read.status());
  const absl::StatusOr<rpc::Security> security = profiles.SecurityOf(profile);
  if (!security.ok()) return OfFiles(security.status());
  const absl::StatusOr<NewKey> key = MakeKey();
  if (!key.ok()) return key.status();
  v1::RenewCertificateRequest request;
  request.set_certificate_request_pem(key->request_pem);
  absl::StatusOr<v1::CertificateResponse> response =
      AskFirst<v1::CertificateResponse>(read->server, [&](const std::string& address) {
        return Call(address, *security, request, &v1::AccessService::Stub::RenewCertificate);
      });
  if (!response.ok()) return response.status();
  AwaitOthers(read->server);
  const absl::Status written = profiles.WriteCertificate(
      profile, absl::StrCat(key->pem, response->certificate_pem(), response->ca_pem()));
  if (!written.ok()) return OfFiles(written);
  return response;
}

absl::Status RenewIfDue(const Profiles& profiles, const std::string& profile, absl::Time now) {
  const absl::StatusOr<Profile> read = profiles.Read(profile);
  if (!read.ok()) return OfFiles(read.status());
  if (!read->has_certificate) return absl::OkStatus();
  const absl::StatusOr<CertificateFacts> facts = profiles.CertificateOf(profile);
  if (!facts.ok()) return OfFiles(facts.status());
  if (absl::Status status = CheckNotExpired(*facts, now); !status.ok()) return status;
  return IsDueForRenewal(*facts, now) ? RenewCertificate(profiles, profile).status() : absl::OkStatus();
}

}  // namespace lumifold::identity
