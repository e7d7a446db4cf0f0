// What proves or names an identity: one-time codes, certificates and requests for them, names of hosts, and
// the profiles of users and workers on their disks.

#include <sys/stat.h>

#include <fstream>
#include <memory>

#include "absl/time/time.h"
#include "proto/identity/certificate.h"
#include "proto/identity/profile.h"
#include "proto/identity/secrets.h"
#include "server/access/certificate_authority.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/temp_folder.h"

namespace lumifold::fuzz {
namespace {

constexpr char kName[] = "default";
const absl::Time kNow = absl::FromUnixSeconds(1'700'000'000);

/// An authority and a profile on disk, made once.
struct Fixture {
  TempFolder folder{InMemory()};
  std::unique_ptr<access::CertificateAuthority> authority;
  identity::Profiles profiles{folder.PathOf("profiles")};
  std::string request;
  std::string certificate;

  Fixture() {
    if (!access::CertificateAuthority::Create(folder.path(), kNow).ok()) Fail("cannot make", "an authority");
    authority = *access::CertificateAuthority::Open(folder.path());
    const std::string key = *identity::MakePrivateKey();
    request = *identity::MakeCertificateRequest(key);
    certificate =
        key +
        authority->SignClient(access::IdentityKind::kWorker, "ann", request, kNow, absl::Hours(24))->pem;
    const identity::Profile profile = {
        .server = "farm:7700", .kind = identity::Profile::Kind::kWorker, .name = "ann"};
    if (!profiles.WritePendingCa(kName, authority->pem()).ok() ||
        !profiles.Write(kName, profile, authority->pem(), certificate).ok())
      Fail("cannot write", "a profile");
  }

  std::string Read(const std::string& name) const {
    std::ifstream file(profiles.FolderOf(kName) + "/" + name, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  void Write(const std::string& name, std::string_view bytes) const {
    const std::string path = profiles.FolderOf(kName) + "/" + name;
    std::ofstream(path, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    chmod(path.c_str(), 0600);
  }
};

Fixture& TheFixture() {
  static Fixture fixture;
  return fixture;
}

void TryProfile(std::string_view bytes) {
  const Fixture& fixture = TheFixture();
  fixture.Write("profile", bytes);
  const absl::StatusOr<identity::Profile> profile = fixture.profiles.Read(kName);
  if (!profile.ok() && profile.status().message().find('\n') != absl::string_view::npos)
    Fail("an error of several lines", std::string(profile.status().message()));
  (void)fixture.profiles.Choose("", "farm:7700", identity::Profile::Kind::kWorker);
  (void)fixture.profiles.SecurityOf(kName);
}

void TryCertificate(std::string_view pem) {
  const absl::StatusOr<identity::CertificateFacts> facts = identity::ReadCertificate(pem);
  if (facts.ok() && facts->sha256.size() != 32) Fail("a certificate without a hash", facts->common_name);
  if (facts.ok()) (void)identity::IsDueForRenewal(*facts, kNow);
}

void TryRequest(std::string_view pem) {
  const auto signed_one =
      TheFixture().authority->SignClient(access::IdentityKind::kPerson, "ben", pem, kNow, absl::Hours(1));
  if (!signed_one.ok()) return;
  // Whatever the request says, the authority chose the name.
  const absl::StatusOr<identity::CertificateFacts> facts = identity::ReadCertificate(signed_one->pem);
  if (!facts.ok() || facts->common_name != "ben") Fail("the request chose the name", signed_one->pem);
}

void TryCode(std::string_view text) {
  const absl::StatusOr<identity::Code> code = identity::ParseCode(text);
  if (code.ok() && (code->ca_sha256.size() != 32 || code->secret.size() != identity::kCodeSecretBytes))
    Fail("a code of the wrong size", std::string(text));
  if (!code.ok() && text.size() > 16 &&
      code.status().message().find({text.data(), text.size()}) != absl::string_view::npos)
    Fail("an error that shows the code", std::string(text));
}

}  // namespace

std::vector<std::string> Seeds() {
  const Fixture& fixture = TheFixture();
  const identity::Code code = {std::string(32, 'a'), std::string(identity::kCodeSecretBytes, 'b')};
  return {"c" + identity::TextOfCode(code),
          "t" + fixture.certificate,
          "t" + fixture.authority->pem(),
          "r" + fixture.request,
          "p" + fixture.Read("profile"),
          "hfarm.example.org",
          "h::1",
          "h192.0.2.1",
          "t" + fixture.request};
}

}  // namespace lumifold::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace lumifold;
  if (size == 0) return 0;
  const std::string_view rest(reinterpret_cast<const char*>(data) + 1, size - 1);
  switch (data[0]) {
    case 'c':
      fuzz::TryCode(rest);
      return 0;
    case 't':
      fuzz::TryCertificate(rest);
      return 0;
    case 'r':
      fuzz::TryRequest(rest);
      return 0;
    case 'p':
      fuzz::TryProfile(rest);
      return 0;
    default:
      (void)access::CheckHost(std::string(rest));
      (void)identity::Profiles::CheckName(std::string(rest));
      return 0;
  }
}
