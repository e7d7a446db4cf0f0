#include "proto/identity/profile.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <system_error>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "proto/identity/certificate.h"
#include "proto/identity/private_file.h"
#include "proto/identity/secrets.h"
#include "proto/rpc/endpoints.h"

namespace lumifold::identity {
namespace {

constexpr int64_t kMaxProfileBytes = 8192;
constexpr size_t kMaxValueBytes = 300;
/// 16 names of hosts, which have at most 253 bytes, and their ports.
constexpr size_t kMaxServerBytes = 4200;
constexpr size_t kMaxNameBytes = 64;
constexpr char kServerKey[] = "server";
constexpr char kKindKey[] = "kind";
constexpr char kNameKey[] = "name";
constexpr char kPerson[] = "person";
constexpr char kWorker[] = "worker";
/// Of which a profile has one.
constexpr std::array kSecretFiles = {"token", "person.pem", "worker.pem"};

bool IsPrintable(absl::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return c > ' ' && c <= '~'; });
}

absl::Status BadLine(const std::string& path, int line, absl::string_view why) {
  return absl::InvalidArgumentError(absl::StrCat(path, ":", line, ": ", why));
}

/// The values of the three keys, each of which must be there once.
absl::StatusOr<std::map<std::string, std::string>> ParseLines(const std::string& path,
                                                              absl::string_view text) {
  std::map<std::string, std::string> values;
  int number = 0;
  if (!absl::ConsumeSuffix(&text, "\n")) return BadLine(path, 1, "the last line does not end");
  for (const absl::string_view line : absl::StrSplit(text, '\n')) {
    ++number;
    const size_t equals = line.find('=');
    if (equals == absl::string_view::npos) return BadLine(path, number, "not KEY=VALUE");
    const absl::string_view key = line.substr(0, equals);
    const absl::string_view value = line.substr(equals + 1);
    if (key != kServerKey && key != kKindKey && key != kNameKey) return BadLine(path, number, "unknown key");
    if (value.empty() || value.size() > (key == kServerKey ? kMaxServerBytes : kMaxValueBytes) ||
        !IsPrintable(value))
      return BadLine(path, number, "the value is empty, too long or not printable");
    if (!values.emplace(key, value).second) return BadLine(path, number, "a key is there twice");
  }
  for (const char* key : {kServerKey, kKindKey, kNameKey}) {
    if (!values.contains(key)) return BadLine(path, number, absl::StrCat("no ", key));
  }
  return values;
}

absl::StatusOr<Profile> ParseProfile(const std::string& path, absl::string_view text) {
  const absl::StatusOr<std::map<std::string, std::string>> values = ParseLines(path, text);
  if (!values.ok()) return values.status();
  Profile profile{
      .server = values->at(kServerKey), .kind = Profile::Kind::kPerson, .name = values->at(kNameKey)};
  const std::string& kind = values->at(kKindKey);
  if (kind != kPerson && kind != kWorker)
    return absl::InvalidArgumentError(absl::StrCat(path, ": kind is neither person nor worker"));
  if (kind == kWorker) profile.kind = Profile::Kind::kWorker;
  if (absl::Status status = rpc::ParseEndpoints(profile.server).status(); !status.ok())
    return absl::InvalidArgumentError(absl::StrCat(path, ": ", status.message()));
  return profile;
}

/// Whether the lists of coordinators have one in common. A list that is not valid has none.
bool HaveOneInCommon(const std::string& list, const std::string& other) {
  const absl::StatusOr<std::vector<std::string>> first = rpc::ParseEndpoints(list);
  const absl::StatusOr<std::vector<std::string>> second = rpc::ParseEndpoints(other);
  return first.ok() && second.ok() &&
         std::find_first_of(first->begin(), first->end(), second->begin(), second->end()) != first->end();
}

absl::Status RemoveFile(const std::string& path) {
  if (unlink(path.c_str()) == 0 || errno == ENOENT) return absl::OkStatus();
  return absl::UnavailableError(
      absl::StrCat("cannot remove ", path, ": ", std::system_category().message(errno)));
}

}  // namespace

std::string ProfilesFolder() {
  const char* config = std::getenv("XDG_CONFIG_HOME");
  // The specification says that a relative path in it is to be ignored.
  if (config != nullptr && config[0] == '/') return absl::StrCat(config, "/lumifold");
  const char* home = std::getenv("HOME");
  return home == nullptr || home[0] != '/' ? "" : absl::StrCat(home, "/.config/lumifold");
}

absl::Status Profiles::CheckName(const std::string& profile) {
  const bool is_name =
      !profile.empty() && profile.size() <= kMaxNameBytes && profile.front() != '.' &&
      std::all_of(profile.begin(), profile.end(), [](char c) {
        return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_' || c == '.';
      });
  if (is_name) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("a profile's name is 1 to ", kMaxNameBytes, " letters, digits, '-', '_' and '.'"));
}

std::string Profiles::PathOf(const std::string& name, const char* file) const {
  return absl::StrCat(folder_, "/", name, "/", file);
}

absl::StatusOr<Profile> Profiles::Read(const std::string& profile) const {
  if (absl::Status status = CheckName(profile); !status.ok()) return status;
  const std::string path = PathOf(profile, "profile");
  const absl::StatusOr<std::string> text = ReadPrivateFile(path, kMaxProfileBytes);
  if (absl::IsNotFound(text.status()))
    return absl::NotFoundError(absl::StrCat("there is no profile '", profile, "' in ", folder_));
  if (!text.ok()) return text.status();
  absl::StatusOr<Profile> read = ParseProfile(path, *text);
  if (!read.ok()) return read;
  struct stat info = {};
  read->has_certificate = read->kind == Profile::Kind::kWorker ||
                          lstat(CertificatePath(profile, Profile::Kind::kPerson).c_str(), &info) == 0;
  return read;
}

std::vector<std::string> Profiles::List() const {
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder_, error)) {
    const std::string name = entry.path().filename().string();
    struct stat info = {};
    if (CheckName(name).ok() && stat(PathOf(name, "profile").c_str(), &info) == 0) names.push_back(name);
  }
  std::sort(names.begin(), names.end());
  return names;
}

absl::StatusOr<rpc::Security> Profiles::SecurityOf(const std::string& name) const {
  const absl::StatusOr<Profile> profile = Read(name);
  if (!profile.ok()) return profile.status();
  rpc::Security security{
      .insecure = false, .ca_path = PathOf(name, "ca.pem"), .certificate_path = "", .token = ""};
  // gRPC says nothing of a file that it cannot read.
  if (auto ca = ReadPrivateFile(security.ca_path, kMaxCertificateFileBytes); !ca.ok()) return ca.status();
  const std::string secret_path =
      profile->has_certificate ? CertificatePath(name, profile->kind) : PathOf(name, "token");
  const absl::StatusOr<std::string> secret = ReadPrivateFile(secret_path, kMaxCertificateFileBytes);
  if (!secret.ok()) return secret.status();
  if (profile->has_certificate) {
    security.certificate_path = secret_path;
    return security;
  }
  security.token = std::string(absl::StripTrailingAsciiWhitespace(*secret));
  if (security.token.empty() || security.token.size() > kMaxSecretTextBytes || !IsPrintable(security.token))
    return absl::InvalidArgumentError(absl::StrCat(secret_path, ": not a token"));
  return security;
}

absl::StatusOr<CertificateFacts> Profiles::CertificateOf(const std::string& name) const {
  const absl::StatusOr<Profile> profile = Read(name);
  if (!profile.ok()) return profile.status();
  const absl::StatusOr<std::string> pem =
      ReadPrivateFile(CertificatePath(name, profile->kind), kMaxCertificateFileBytes);
  if (!pem.ok()) return pem.status();
  return ReadCertificate(*pem);
}

absl::StatusOr<std::optional<std::string>> Profiles::Choose(const std::string& named,
                                                            const std::string& server,
                                                            Profile::Kind kind) const {
  if (!named.empty()) {
    const absl::StatusOr<Profile> profile = Read(named);
    if (!profile.ok()) return profile.status();
    if (!server.empty() && !HaveOneInCommon(profile->server, server)) {
      return absl::InvalidArgumentError(
          absl::StrCat("the profile '", named, "' is of ", profile->server, ", not of ", server));
    }
    return named;
  }
  std::vector<std::string> names = List();
  // One that was named by nobody must not come before the default.
  std::stable_partition(names.begin(), names.end(),
                        [](const std::string& name) { return name == kDefaultProfile; });
  for (const std::string& name : names) {
    if (server.empty() && name != kDefaultProfile) continue;
    const absl::StatusOr<Profile> profile = Read(name);
    if (!profile.ok()) return profile.status();
    if (profile->kind == kind && (server.empty() || HaveOneInCommon(profile->server, server))) return name;
  }
  return std::nullopt;
}

absl::StatusOr<std::string> Profiles::WritePendingCa(const std::string& name, std::string_view ca_pem) const {
  absl::Status status = CheckName(name);
  if (status.ok() && folder_.empty())
    status = absl::FailedPreconditionError(
        "neither XDG_CONFIG_HOME nor HOME is set: there is no place for a profile");
  if (status.ok()) status = MakePrivateFolder(absl::StrCat(folder_, "/", name));
  const std::string path = PathOf(name, "ca.pem.pending");
  if (status.ok()) status = WritePrivateFile(path, ca_pem);
  if (!status.ok()) return status;
  return path;
}

absl::Status Profiles::Write(const std::string& name, const Profile& profile, std::string_view ca_pem,
                             std::string_view secret) const {
  const bool is_worker = profile.kind == Profile::Kind::kWorker;
  const std::string text =
      absl::StrCat(kServerKey, "=", profile.server, "\n", kKindKey, "=", is_worker ? kWorker : kPerson, "\n",
                   kNameKey, "=", profile.name, "\n");
  absl::Status status = ParseProfile(PathOf(name, "profile"), text).status();
  if (status.ok()) status = WritePrivateFile(PathOf(name, "ca.pem"), ca_pem);
  // The others first: whatever stops it, nobody is left with two identities.
  const std::string secret_path =
      is_worker || profile.has_certificate ? CertificatePath(name, profile.kind) : PathOf(name, "token");
  for (const char* file : kSecretFiles) {
    if (status.ok() && PathOf(name, file) != secret_path) status = RemoveFile(PathOf(name, file));
  }
  if (status.ok()) status = WritePrivateFile(secret_path, secret);
  if (status.ok()) status = WritePrivateFile(PathOf(name, "profile"), text);
  if (status.ok()) status = RemoveFile(PathOf(name, "ca.pem.pending"));
  return status;
}

absl::Status Profiles::WriteCertificate(const std::string& name, std::string_view pem) const {
  const absl::StatusOr<Profile> profile = Read(name);
  if (!profile.ok()) return profile.status();
  return WritePrivateFile(CertificatePath(name, profile->kind), pem);
}

absl::Status Profiles::Remove(const std::string& name) const {
  absl::Status status = CheckName(name);
  if (status.ok() && !std::filesystem::exists(PathOf(name, "profile")))
    return absl::NotFoundError(absl::StrCat("there is no profile '", name, "' in ", folder_));
  for (const char* file : kSecretFiles) {
    if (status.ok()) status = RemoveFile(PathOf(name, file));
  }
  for (const char* file : {"ca.pem", "ca.pem.pending", "profile"}) {
    if (status.ok()) status = RemoveFile(PathOf(name, file));
  }
  if (status.ok())
    rmdir(absl::StrCat(folder_, "/", name).c_str());  // it stays where the user has put other files in it
  return status;
}

}  // namespace lumifold::identity
