#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace lumifold::sandbox {

/// What a process may still do inside the sandbox. Limits of 0 mean none.
struct SandboxOptions {
  /// User to become if the process is root; empty: stay. Capabilities are dropped in any case.
  std::string user = {};
  /// Keep the capability to open files of other users; for a process that stays root and works in their
  /// folder.
  bool keep_file_access = false;
  /// Limit of the address space in bytes. Not set under AddressSanitizer, which reserves terabytes.
  uint64_t memory_bytes = 0;
  uint64_t open_files = 0;
  uint64_t file_bytes = 0;
  /// Files and folders that may be read, besides those of the system (libraries, name resolution,
  /// certificates); of `writable` folders files may also be written, made, renamed and removed. Those that do
  /// not exist are left out.
  std::vector<std::string> readable = {};
  std::vector<std::string> writable = {};
  /// False: no sockets at all. True: as a client only, never listening.
  bool network = false;
  /// It may accept connections to sockets that listen already when it enters the sandbox.
  bool accepts = false;
  /// TCP ports to which it may connect; empty: all.
  std::vector<uint16_t> connect_ports = {};
};

/// What the sandbox consists of, for the log: each entry a few words.
struct SandboxReport {
  std::vector<std::string> up;
  std::vector<std::string> lacking;  // with the reason, mostly an old kernel
};

/// Puts this process into a sandbox that it cannot leave: limits of resources, no core dumps, another user,
/// no capabilities, no new privileges, files and ports by Landlock, and a seccomp filter against system calls
/// that a renderer never needs: new programs and processes, tracing, mounts, namespaces, kernel modules,
/// listening sockets, signals to others. A sandbox that the kernel lacks is reported, not an error.
/// Errors: kFailedPrecondition if the process has more than one thread, since a sandbox holds only for
/// threads that start later; kNotFound for an unknown user; kPermissionDenied and others of the system,
/// naming the step. After an error the process may be partly sandboxed: end it.
absl::StatusOr<SandboxReport> EnterSandbox(const SandboxOptions& options);

/// Where control groups, of version 1 or 2, are shown, and which of them this process is in.
struct ControlGroups {
  std::string folder = "/sys/fs/cgroup";
  std::string membership = "/proc/self/cgroup";
};

/// Memory of this machine or of the control groups of this process, whichever is least.
uint64_t UsableMemoryBytes(const ControlGroups& control_groups = {});

/// The same, or what a limit of the address space leaves: `address_space`, or that which the process has
/// already if that is less; 0: none. Beside `threads` threads of its own. Before threads start.
uint64_t MemoryOfThisProcess(uint64_t address_space, int threads);

/// Address space for a renderer with so many threads: the usable memory, and what threads reserve without
/// using it. A scene that needs more fails to load, instead of making the machine swap.
uint64_t DefaultMemoryBytes(int threads, const ControlGroups& control_groups = {});

/// Raises the niceness of this process to `niceness`, where it is lower. For threads that start later, and
/// this one.
/// Errors: of the system.
absl::Status YieldToOthers(int niceness);

/// "lumifold" if this machine has that user, else "nobody".
std::string DefaultUser();

}  // namespace lumifold::sandbox
