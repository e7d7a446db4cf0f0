#include "server/access/access_control.h"

#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "proto/identity/private_file.h"
#include "proto/logging/fields.h"

namespace lumifold::access {
namespace {

constexpr absl::Duration kRefreshInterval = absl::Seconds(1);
/// Who comes with what has expired for less than this is told so, and not that it is not valid.
constexpr absl::Duration kKnownAfterExpiry = absl::Hours(24 * 7);
constexpr int64_t kMaxHostsBytes = 65536;

std::string ServerCertificatePath(const std::string& folder) { return folder + "/server.pem"; }
std::string HostsPath(const std::string& folder) { return folder + "/names"; }
std::string StorePath(const std::string& folder) { return folder + "/access.db"; }

/// The names that the server's certificate should have. Whoever runs the coordinator may edit the file.
absl::StatusOr<std::vector<std::string>> ReadHosts(const std::string& folder) {
  const absl::StatusOr<std::string> text = identity::ReadPrivateFile(HostsPath(folder), kMaxHostsBytes);
  if (!text.ok()) return text.status();
  std::vector<std::string> hosts = absl::StrSplit(*text, '\n', absl::SkipWhitespace());
  for (const std::string& host : hosts) {
    if (absl::Status status = CheckHost(host); !status.ok())
      return absl::InvalidArgumentError(absl::StrCat(HostsPath(folder), ": ", status.message()));
  }
  return HostsOfServer(hosts);
}

absl::StatusOr<identity::CertificateFacts> ReadServerCertificate(const std::string& folder) {
  const absl::StatusOr<std::string> pem =
      identity::ReadPrivateFile(ServerCertificatePath(folder), identity::kMaxCertificateFileBytes);
  if (!pem.ok()) return pem.status();
  return identity::ReadCertificate(*pem);
}

absl::Status FillAccessFolder(const AccessOptions& options, const std::string& folder,
                              const std::vector<std::string>& hosts) {
  absl::Status status = CertificateAuthority::Create(folder, options.wall_now());
  if (status.ok())
    status = identity::WritePrivateFile(HostsPath(folder), absl::StrCat(absl::StrJoin(hosts, "\n"), "\n"));
  if (!status.ok()) return status;
  const absl::StatusOr<std::unique_ptr<CertificateAuthority>> authority = CertificateAuthority::Open(folder);
  if (!authority.ok()) return authority.status();
  const absl::StatusOr<std::string> pem =
      (*authority)->SignServer(hosts, options.wall_now(), options.certificate_lifetime);
  if (!pem.ok()) return pem.status();
  status = identity::WritePrivateFile(ServerCertificatePath(folder), *pem);
  return status.ok() ? AccessStore::Open(options.store, StorePath(folder)).status() : status;
}

}  // namespace

bool HasAccessFolder(const std::string& folder) {
  struct stat info = {};
  return lstat(folder.c_str(), &info) == 0;
}

absl::Status MakeAccessFolder(const AccessOptions& options, const std::vector<std::string>& names) {
  for (const std::string& name : names) {
    if (absl::Status status = CheckHost(name); !status.ok()) return status;
  }
  if (HasAccessFolder(options.folder)) {
    return absl::AlreadyExistsError(
        absl::StrCat(options.folder,
                     " exists: this coordinator has been set up before. More people and workers are "
                     "invited with 'lumifold invite'"));
  }
  // In a folder of another name, so that an attempt that was interrupted leaves a coordinator that is not set
  // up.
  const std::string partial = absl::StrCat(options.folder, ".", getpid(), ".partial");
  absl::Status status = identity::MakePrivateFolder(partial);
  if (status.ok()) status = FillAccessFolder(options, partial, HostsOfServer(names));
  std::error_code error;
  if (status.ok()) std::filesystem::rename(partial, options.folder, error);
  if (error) status = absl::UnavailableError(absl::StrCat(options.folder, ": ", error.message()));
  if (!status.ok()) std::filesystem::remove_all(partial, error);
  return status;
}

absl::StatusOr<std::unique_ptr<AccessControl>> AccessControl::Open(AccessOptions options) {
  absl::StatusOr<std::unique_ptr<CertificateAuthority>> authority =
      CertificateAuthority::Open(options.folder);
  if (!authority.ok()) return authority.status();
  absl::StatusOr<std::unique_ptr<AccessStore>> store =
      AccessStore::Open(options.store, StorePath(options.folder));
  if (!store.ok()) return store.status();
  std::unique_ptr<AccessControl> access(
      new AccessControl(std::move(options), *std::move(authority), *std::move(store)));
  absl::Status status = access->RenewServerCertificate();
  if (status.ok()) status = access->ReadChanges();
  if (!status.ok()) return status;
  return access;
}

std::vector<std::string> AccessControl::Hosts() const {
  return ReadHosts(options_.folder).value_or(std::vector<std::string>());
}

rpc::Security AccessControl::security() const {
  return {.insecure = false,
          .ca_path = options_.folder + "/ca.pem",
          .certificate_path = ServerCertificatePath(options_.folder),
          .token = ""};
}

absl::Status AccessControl::RenewServerCertificate() {
  const absl::StatusOr<std::vector<std::string>> hosts = ReadHosts(options_.folder);
  if (!hosts.ok()) return hosts.status();
  const absl::StatusOr<identity::CertificateFacts> present = ReadServerCertificate(options_.folder);
  const absl::Time now = options_.wall_now();
  // One that lives longer than is wanted now is replaced too.
  const bool is_good = present.ok() && present->hosts == *hosts &&
                       !identity::IsDueForRenewal(*present, now) &&
                       present->not_after <= now + options_.certificate_lifetime;
  if (is_good) return absl::OkStatus();
  const absl::StatusOr<std::string> pem = authority_->SignServer(*hosts, now, options_.certificate_lifetime);
  if (!pem.ok()) return pem.status();
  if (absl::Status status = identity::WritePrivateFile(ServerCertificatePath(options_.folder), *pem);
      !status.ok())
    return status;
  options_.log->info("event=server_certificate_renewed expires={}",
                     absl::FormatTime(now + options_.certificate_lifetime, absl::UTCTimeZone()));
  return absl::OkStatus();
}

absl::Status AccessControl::ReadChanges() {
  absl::MutexLock lock(&mutex_);
  // Before the rows: what changes in between is read again.
  const absl::StatusOr<int64_t> version = store_->Version();
  if (!version.ok()) return version.status();
  if (*version == read_version_) return absl::OkStatus();
  absl::StatusOr<std::vector<NewCredential>> identities =
      store_->Identities(options_.wall_now() - kKnownAfterExpiry);
  if (!identities.ok()) return identities.status();
  // Under the lock, so that it cannot undo the Add of one that was made meanwhile.
  known_.Replace(*std::move(identities));
  read_version_ = *version;
  return absl::OkStatus();
}

void AccessControl::Refresh() {
  const absl::Status read = ReadChanges();
  {
    // What is known stays valid while the store is away: without it nothing is revoked, and nobody gets in
    // either.
    absl::MutexLock lock(&mutex_);
    if (!read.ok() && !is_store_lost_)
      options_.log->error("event=access_store_lost error={}", logging::Quoted(read.message()));
    if (read.ok() && is_store_lost_) options_.log->info("event=access_store_back");
    is_store_lost_ = !read.ok();
  }
  const absl::Time now = options_.wall_now();
  const size_t ended =
      open_calls_.EndUnless([this, now](const Identity& caller) { return known_.Check(caller, now); });
  if (ended > 0) options_.log->info("event=calls_ended count={}", ended);
  if (const absl::Status renewed = RenewServerCertificate(); !renewed.ok())
    options_.log->error("event=server_certificate_not_renewed error={}", logging::Quoted(renewed.message()));
}

void AccessControl::Start() {
  thread_ = std::thread([this] {
    while (!stop_.WaitFor(kRefreshInterval)) Refresh();
  });
}

void AccessControl::Stop() {
  stop_.Notify();
  if (thread_.joinable()) thread_.join();
}

}  // namespace lumifold::access
