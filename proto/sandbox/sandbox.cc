#include "proto/sandbox/sandbox.h"

#include <grp.h>
#include <linux/capability.h>
#include <pwd.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <optional>
#include <system_error>

#include "absl/algorithm/container.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "proto/sandbox/landlock.h"
#include "proto/sandbox/system_call_filter.h"

#if defined(__SANITIZE_ADDRESS__)
#define LUMIFOLD_ADDRESS_SANITIZER 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define LUMIFOLD_ADDRESS_SANITIZER 1
#endif
#endif

namespace lumifold::sandbox {
namespace {

#ifdef LUMIFOLD_ADDRESS_SANITIZER
constexpr bool kReservesAddresses = true;
bool is_sandboxed = false;  // LeakSanitizer asks for it
#else
constexpr bool kReservesAddresses = false;
#endif

/// Folders of the system that a sandboxed process reads: libraries that are loaded late, certificates, name
/// resolution (/etc/resolv.conf is often a link into /run), what TBB asks about processors and limits of
/// memory.
constexpr const char* kSystemFolders[] = {
    "/usr",
    "/lib",
    "/lib64",
    "/run/systemd/resolve",
    "/run/resolvconf",
    "/run/nscd",
    "/run/NetworkManager",
    "/proc/self",
    "/proc/cpuinfo",
    "/proc/meminfo",
    "/proc/stat",
    "/proc/sys/vm",
    "/proc/sys/kernel",
    "/proc/sys/net",
    "/sys/devices/system",
    "/sys/fs/cgroup",
    "/sys/kernel/mm",
    "/dev/urandom",
    "/dev/random",
    "/dev/zero",
};

/// Of /etc, for a process that stays root and could read its secrets. A rule for a file holds for that file,
/// not for another that later replaces it, so others get the whole folder: their user may not read what is
/// secret.
constexpr const char* kFilesOfEtc[] = {
    "/etc/resolv.conf", "/etc/hosts",     "/etc/host.conf", "/etc/nsswitch.conf", "/etc/gai.conf",
    "/etc/services",    "/etc/protocols", "/etc/localtime", "/etc/ssl",           "/etc/ca-certificates",
    "/etc/pki",         "/etc/passwd",    "/etc/group",     "/etc/ld.so.cache",
};

absl::Status SystemError(absl::string_view what) {
  const int error = errno;
  return {absl::ErrnoToStatusCode(error), absl::StrCat("sandbox: ", what, ": ", std::strerror(error))};
}

absl::Status CheckIsSingleThread() {
  std::error_code error;
  std::filesystem::directory_iterator entry("/proc/self/task", error), end;
  if (error) return absl::FailedPreconditionError("sandbox: /proc is not mounted");
  const auto threads = std::distance(entry, end);
  if (threads == 1) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrCat(
      "sandbox: the process has ", threads, " threads; only those that start later would be sandboxed"));
}

absl::Status Limit(__rlimit_resource resource, const char* name, uint64_t value) {
  rlimit limit = {};
  if (getrlimit(resource, &limit) != 0) return SystemError(name);
  limit.rlim_max = std::min<rlim_t>(limit.rlim_max, value);
  limit.rlim_cur = limit.rlim_max;
  if (setrlimit(resource, &limit) != 0) return SystemError(name);
  return absl::OkStatus();
}

/// The limit that the process has; none: the largest number.
uint64_t AddressSpaceLimit() {
  rlimit own = {};
  return getrlimit(RLIMIT_AS, &own) != 0 || own.rlim_cur == RLIM_INFINITY
             ? std::numeric_limits<uint64_t>::max()
             : own.rlim_cur;
}

absl::Status LimitResources(const SandboxOptions& options, SandboxReport* report) {
  if (absl::Status status = Limit(RLIMIT_CORE, "core dumps", 0); !status.ok()) return status;
  if (prctl(PR_SET_DUMPABLE, 0) != 0) return SystemError("core dumps");
  report->up.emplace_back("no core dumps");
  if (options.memory_bytes > 0 && kReservesAddresses) {
    report->lacking.emplace_back("memory (built with AddressSanitizer)");
  } else if (options.memory_bytes > 0) {
    // Whoever starts it as root has limited it on purpose, too.
    const uint64_t bytes = std::min(options.memory_bytes, AddressSpaceLimit());
    if (absl::Status status = Limit(RLIMIT_AS, "memory", bytes); !status.ok()) return status;
    report->up.push_back(absl::StrCat("memory ", bytes >> 20, " MiB"));
  }
  if (options.open_files > 0) {
    if (absl::Status status = Limit(RLIMIT_NOFILE, "open files", options.open_files); !status.ok())
      return status;
    report->up.push_back(absl::StrCat(options.open_files, " open files"));
  }
  if (options.file_bytes > 0) {
    signal(SIGXFSZ, SIG_IGN);  // the write fails; a log that is full must not end the process
    if (absl::Status status = Limit(RLIMIT_FSIZE, "file size", options.file_bytes); !status.ok())
      return status;
    report->up.push_back(absl::StrCat("files of ", options.file_bytes >> 20, " MiB"));
  }
  return absl::OkStatus();
}

struct User {
  uid_t id = 0;
  gid_t group = 0;
};

absl::StatusOr<User> FindUser(const std::string& name) {
  errno = 0;
  const passwd* entry = getpwnam(name.c_str());  // one thread runs
  if (entry == nullptr) return absl::NotFoundError(absl::StrCat("sandbox: no user '", name, "'"));
  return User{entry->pw_uid, entry->pw_gid};
}

absl::Status BecomeUser(const SandboxOptions& options, const std::optional<User>& user,
                        SandboxReport* report) {
  if (!user.has_value()) {
    report->up.push_back(absl::StrCat("user ", getuid()));
    return absl::OkStatus();
  }
  if (setgroups(0, nullptr) != 0 || setresgid(user->group, user->group, user->group) != 0 ||
      setresuid(user->id, user->id, user->id) != 0) {
    return SystemError(absl::StrCat("becoming user ", options.user, " ('--user root' stays root)"));
  }
  report->up.push_back(absl::StrCat("user ", options.user));
  return absl::OkStatus();
}

absl::Status DropCapabilities(bool keep_file_access, SandboxReport* report) {
  __user_cap_header_struct header = {.version = _LINUX_CAPABILITY_VERSION_3, .pid = 0};
  std::array<__user_cap_data_struct, _LINUX_CAPABILITY_U32S_3> sets = {};
  if (syscall(SYS_capget, &header, sets.data()) != 0) return SystemError("capabilities");
  const uint32_t kept = keep_file_access ? (1U << CAP_DAC_OVERRIDE) & sets[0].permitted : 0;
  sets = {};
  sets[0] = {.effective = kept, .permitted = kept, .inheritable = 0};
  if (syscall(SYS_capset, &header, sets.data()) != 0) return SystemError("capabilities");
  report->up.emplace_back(kept != 0 ? "no capabilities but for files" : "no capabilities");
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) return SystemError("no new privileges");
  report->up.emplace_back("no new privileges");
  return absl::OkStatus();
}

LandlockRules RulesOf(const SandboxOptions& options, bool stays_root) {
  LandlockRules rules = {options.readable, options.writable, options.connect_ports};
  for (const char* folder : kSystemFolders) rules.readable.emplace_back(folder);
  if (stays_root) {
    for (const char* file : kFilesOfEtc) rules.readable.emplace_back(file);
  } else {
    rules.readable.emplace_back("/etc");
  }
  rules.writable.emplace_back("/dev/null");
  return rules;
}

absl::Status FilterCalls(const SandboxOptions& options, SandboxReport* report) {
  absl::Status status = FilterSystemCalls({.network = options.network, .accepts = options.accepts});
  if (status.ok()) report->up.emplace_back(options.network ? "system calls" : "system calls, no network");
  if (!absl::IsUnimplemented(status)) return status;
  report->lacking.push_back(absl::StrCat("system calls (", std::string(status.message()), ")"));
  return absl::OkStatus();
}

/// The least limit of a control group and those above it.
uint64_t LeastMemoryLimit(const std::string& root, std::string group, const std::string& file) {
  uint64_t least = std::numeric_limits<uint64_t>::max();
  while (true) {
    std::string text;
    uint64_t bytes = 0;
    if (std::ifstream(absl::StrCat(root, group, "/", file)) >> text && absl::SimpleAtoi(text, &bytes))
      least = std::min(least, bytes);
    if (group.empty()) return least;
    group.resize(std::min(group.size(), group.rfind('/')));
  }
}

/// The limit of this process's control group: of version 2, and of the controller "memory" of version 1.
uint64_t MemoryOfControlGroup(const ControlGroups& control_groups) {
  constexpr char kFile[] = "memory.max";
  constexpr char kOldFile[] = "memory.limit_in_bytes";
  const std::string old_root = control_groups.folder + "/memory";
  // Within a container what is mounted may be the group itself, whatever it is called outside.
  uint64_t least =
      std::min(LeastMemoryLimit(control_groups.folder, "", kFile), LeastMemoryLimit(old_root, "", kOldFile));
  std::ifstream membership(control_groups.membership);  // lines of NUMBER:CONTROLLERS:GROUP
  for (std::string line; std::getline(membership, line);) {
    const std::vector<std::string> parts = absl::StrSplit(line, absl::MaxSplits(':', 2));
    if (parts.size() != 3 || !absl::StartsWith(parts[2], "/")) continue;
    const std::vector<std::string> controllers = absl::StrSplit(parts[1], ',');
    if (parts[1].empty()) least = std::min(least, LeastMemoryLimit(control_groups.folder, parts[2], kFile));
    if (absl::c_linear_search(controllers, "memory"))
      least = std::min(least, LeastMemoryLimit(old_root, parts[2], kOldFile));
  }
  return least;
}

/// Addresses in use.
uint64_t AddressSpaceInUse() {
  uint64_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  return pages * static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
}

}  // namespace

absl::StatusOr<SandboxReport> EnterSandbox(const SandboxOptions& options) {
  SandboxReport report;
  if (absl::Status status = CheckIsSingleThread(); !status.ok()) return status;
  std::optional<User> user;
  if (geteuid() == 0 && !options.user.empty()) {
    const absl::StatusOr<User> found = FindUser(options.user);
    if (!found.ok()) return found.status();
    user = *found;
  }
  if (absl::Status status = LimitResources(options, &report); !status.ok()) return status;
  // The rules name paths that the other user may not reach.
  std::optional<Landlock> landlock;
  if (Landlock::KernelVersion() > 0) {
    const uid_t id = user.has_value() ? user->id : geteuid();
    absl::StatusOr<Landlock> created = Landlock::Create(RulesOf(options, id == 0));
    if (!created.ok()) return created.status();
    landlock.emplace(*std::move(created));
  }
  if (absl::Status status = BecomeUser(options, user, &report); !status.ok()) return status;
  if (absl::Status status = DropCapabilities(options.keep_file_access, &report); !status.ok()) return status;
  if (landlock.has_value()) {
    if (absl::Status status = landlock->Enforce(); !status.ok()) return status;
    report.up.push_back(absl::StrCat("landlock (", landlock->Scope(), ")"));
  } else {
    report.lacking.emplace_back("landlock (this kernel has none)");
  }
  if (absl::Status status = FilterCalls(options, &report); !status.ok()) return status;
#ifdef LUMIFOLD_ADDRESS_SANITIZER
  is_sandboxed = true;
#endif
  return report;
}

uint64_t UsableMemoryBytes(const ControlGroups& control_groups) {
  const auto pages = static_cast<uint64_t>(std::max(0L, sysconf(_SC_PHYS_PAGES)));
  const uint64_t machine = pages * static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
  return std::min(machine, MemoryOfControlGroup(control_groups));
}

uint64_t MemoryOfThisProcess(uint64_t address_space, int threads) {
  // Stacks, and what else a thread of ours or of a library takes of the addresses.
  constexpr uint64_t kPerThread = uint64_t{12} << 20;
  constexpr uint64_t kOtherThreads = 16;
  uint64_t limit = AddressSpaceLimit();
  if (address_space > 0) limit = std::min(limit, address_space);
  const uint64_t taken = AddressSpaceInUse() + (static_cast<uint64_t>(threads) + kOtherThreads) * kPerThread;
  return std::min(UsableMemoryBytes(), limit > taken ? limit - taken : 0);
}

uint64_t DefaultMemoryBytes(int threads, const ControlGroups& control_groups) {
  // Stack and heap of a thread in glibc are 8 and 64 MiB of addresses, twice the heap while it is aligned.
  // gRPC, TBB and the log have threads of their own.
  constexpr uint64_t kPerThread = uint64_t{160} << 20;
  constexpr uint64_t kOtherThreads = 32;
  return UsableMemoryBytes(control_groups) + (static_cast<uint64_t>(threads) + kOtherThreads) * kPerThread;
}

absl::Status YieldToOthers(int niceness) {
  if (getpriority(PRIO_PROCESS, 0) >= niceness || setpriority(PRIO_PROCESS, 0, niceness) == 0)
    return absl::OkStatus();
  return absl::ErrnoToStatus(errno, "setpriority");
}

std::string DefaultUser() { return getpwnam("lumifold") != nullptr ? "lumifold" : "nobody"; }

}  // namespace lumifold::sandbox

#ifdef LUMIFOLD_ADDRESS_SANITIZER
/// LeakSanitizer stops all threads from a process that it starts, which the sandbox refuses.
extern "C" int __lsan_is_turned_off() { return lumifold::sandbox::is_sandboxed ? 1 : 0; }
#endif
