#include "proto/sandbox/landlock.h"

#include <fcntl.h>
#include <linux/landlock.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"

namespace lumifold::sandbox {
namespace {

// Debian's headers are older than the kernels on which this may run, so what came after version 2 is defined
// here, as in the kernel's include/uapi/linux/landlock.h.
constexpr uint64_t kRefer = uint64_t{1} << 13;     // version 2
constexpr uint64_t kTruncate = uint64_t{1} << 14;  // version 3
constexpr uint64_t kIoctlDev = uint64_t{1} << 15;  // version 5
constexpr uint64_t kBindTcp = 1;                   // version 4
constexpr uint64_t kConnectTcp = 2;                // version 4
constexpr uint64_t kAbstractSockets = 1;           // version 6
constexpr uint64_t kSignals = 2;                   // version 6
constexpr int kPortRule = 2;

struct RulesetAttributes {
  uint64_t files = 0;
  uint64_t ports = 0;   // version 4
  uint64_t scoped = 0;  // version 6
};
struct PortAttributes {
  uint64_t allowed = 0;
  uint64_t port = 0;
};

constexpr uint64_t kAllOfVersion1 = (uint64_t{1} << 13) - 1;
constexpr uint64_t kRead = LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR;
constexpr uint64_t kWrite = kRead | LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_REMOVE_DIR |
                            LANDLOCK_ACCESS_FS_REMOVE_FILE | LANDLOCK_ACCESS_FS_MAKE_DIR |
                            LANDLOCK_ACCESS_FS_MAKE_REG | kRefer | kTruncate;
/// What a rule for a file, rather than a folder, may allow.
constexpr uint64_t kOfFiles = LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_WRITE_FILE | kTruncate;

absl::Status SystemError(const std::string& what) {
  const int error = errno;
  return {absl::ErrnoToStatusCode(error), absl::StrCat("landlock: ", what, ": ", std::strerror(error))};
}

uint64_t FilesOf(int version) {
  return kAllOfVersion1 | (version >= 2 ? kRefer : 0) | (version >= 3 ? kTruncate : 0) |
         (version >= 5 ? kIoctlDev : 0);
}

absl::Status AddPath(int rules, const std::string& path, uint64_t allowed) {
  const int handle = open(path.c_str(), O_PATH | O_CLOEXEC);
  if (handle < 0 && (errno == ENOENT || errno == ENOTDIR || errno == EACCES)) return absl::OkStatus();
  if (handle < 0) return SystemError(path);
  struct stat info = {};
  absl::Status status = absl::OkStatus();
  if (fstat(handle, &info) != 0) status = SystemError(path);
  landlock_path_beneath_attr rule = {};
  rule.parent_fd = handle;
  rule.allowed_access = S_ISDIR(info.st_mode) ? allowed : allowed & kOfFiles;
  if (status.ok() && syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &rule, 0) != 0)
    status = SystemError(path);
  close(handle);
  return status;
}

absl::Status AddPort(int rules, uint16_t port, uint64_t allowed) {
  const PortAttributes rule = {allowed, port};
  if (syscall(SYS_landlock_add_rule, rules, kPortRule, &rule, 0) != 0)
    return SystemError(absl::StrCat("port ", port));
  return absl::OkStatus();
}

}  // namespace

Landlock::Landlock(Landlock&& other) noexcept
    : version_(other.version_), rules_(std::exchange(other.rules_, -1)), has_ports_(other.has_ports_) {}

Landlock::~Landlock() {
  if (rules_ >= 0) close(rules_);
}

int Landlock::KernelVersion() {
  const long version = syscall(SYS_landlock_create_ruleset, nullptr, 0, LANDLOCK_CREATE_RULESET_VERSION);
  return version < 0 ? 0 : static_cast<int>(version);
}

absl::StatusOr<Landlock> Landlock::Create(const LandlockRules& rules) {
  const int version = KernelVersion();
  const bool has_ports = version >= 4 && !rules.connect_ports.empty();
  RulesetAttributes attributes;
  attributes.files = FilesOf(version);
  attributes.ports = version < 4 ? 0 : has_ports ? kBindTcp | kConnectTcp : kBindTcp;
  attributes.scoped = version >= 6 ? kAbstractSockets | kSignals : 0;
  // Older kernels know the first members only.
  const size_t size = version >= 6   ? sizeof(attributes)
                      : version >= 4 ? 2 * sizeof(uint64_t)
                                     : sizeof(uint64_t);
  const auto set = static_cast<int>(syscall(SYS_landlock_create_ruleset, &attributes, size, 0));
  if (set < 0) return SystemError("the set of rules");
  Landlock landlock(version, set, has_ports);
  for (const std::string& path : rules.readable) {
    if (absl::Status status = AddPath(set, path, kRead); !status.ok()) return status;
  }
  for (const std::string& path : rules.writable) {
    if (absl::Status status = AddPath(set, path, kWrite & attributes.files); !status.ok()) return status;
  }
  // gRPC binds a socket to a free port of ::1 to find out whether the machine has IPv6.
  if (version >= 4) {
    if (absl::Status status = AddPort(set, 0, kBindTcp); !status.ok()) return status;
  }
  if (has_ports) {
    for (const uint16_t port : rules.connect_ports) {
      if (absl::Status status = AddPort(set, port, kConnectTcp); !status.ok()) return status;
    }
  }
  return landlock;
}

absl::Status Landlock::Enforce() const {
  if (syscall(SYS_landlock_restrict_self, rules_, 0) != 0) return SystemError("restricting this process");
  return absl::OkStatus();
}

std::string Landlock::Scope() const {
  return absl::StrCat("files", has_ports_ ? ", ports" : "", version_ >= 6 ? ", signals" : "");
}

}  // namespace lumifold::sandbox
